"""The documentation site: its pictures and replays are made by what they show, its links are checked, no page is left out."""

import re
from pathlib import Path
from types import ModuleType

import pytest

from tests.tool_modules import tool

ROOT = Path(__file__).parents[1]
PAGES = sorted(p.relative_to(ROOT / "docs").as_posix() for p in (ROOT / "docs").rglob("*.md"))


@pytest.fixture(scope="module")
def check() -> ModuleType:
    return tool("check_site")


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    return tool("site_hooks")


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A site of two pages in which every link is alive."""
    (tmp_path / "below").mkdir()
    (tmp_path / "picture.svg").write_text("<svg/>")
    (tmp_path / "index.html").write_text(
        '<link rel="canonical" href="https://example.org/project/index.html"><h1 id="top">T</h1>'
        '<a href="below/page.html#part">p</a><a href="#top">t</a><a href="below/page.html#t=3.2">r</a>'
        '<img src="picture.svg"><a href="https://example.org/elsewhere">e</a><a href="mailto:a@example.org">m</a>'
    )
    (tmp_path / "below" / "page.html").write_text('<h2 id="part">P</h2><a href="../index.html">i</a><a href="/project/">r</a>')
    return tmp_path


def test_a_site_without_dead_links_passes(check: ModuleType, site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["check_site.py", str(site)])
    assert check.dead(site) == []
    assert check.main() == 0


@pytest.mark.parametrize(
    ("markup", "told"),
    [
        ('<a href="no.html">', "below/page.html: no.html leads to no file"),
        ('<a href="../index.html#nowhere">', "below/page.html: ../index.html#nowhere names no element of that page"),
        ('<a href="#nowhere">', "below/page.html: #nowhere names no element of that page"),
        ('<a href="/project/no.html">', "below/page.html: /project/no.html leads to no file"),
        ('<iframe src="no.html#t=1.0">', "below/page.html: no.html#t=1.0 leads to no file"),
        ('<script src="https://cdn.example.org/x.js">', "below/page.html: loads https://cdn.example.org/x.js from another host"),
        ('<link rel="stylesheet" href="//example.org/x.css">', "below/page.html: loads //example.org/x.css from another host"),
    ],
)
def test_dead_links_and_foreign_loads_are_reported(
    check: ModuleType, site: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], markup: str, told: str
) -> None:
    page = site / "below" / "page.html"
    page.write_text(page.read_text() + markup)
    monkeypatch.setattr("sys.argv", ["check_site.py", str(site)])
    assert check.main() == 1
    assert capsys.readouterr().out.splitlines() == [told, "2 pages, 1 dead links or foreign loads"]


def test_style_with_a_foreign_load_is_reported(check: ModuleType, site: Path) -> None:
    (site / "x.css").write_text("@font-face{src:url('https://fonts.example.org/a.woff2')}b{background:url(data:,)}")
    assert check.dead(site) == ["x.css: loads https://fonts.example.org/a.woff2 from another host"]


def test_a_folder_without_pages_is_no_site(check: ModuleType, tmp_path: Path) -> None:
    assert check.dead(tmp_path) == [f"{tmp_path}: no page is there"]


def test_every_page_is_in_the_navigation(hooks: ModuleType) -> None:
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    named = re.findall(r"([\w/.-]+\.md)$", nav, re.MULTILINE)
    assert sorted(set(named)) == sorted([*PAGES, "options.md", "commands.md", *hooks.COPIED])
    assert len(named) == len(set(named))


def test_the_icon_of_the_site_is_small_and_still() -> None:
    name = re.search(r"^  favicon: ([\w.-]+)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    assert name
    icon = (ROOT / "docs" / name[1]).read_text(encoding="utf-8")
    assert len(icon) < 1000
    assert not re.search(r"animat|@keyframes|<script", icon)


@pytest.mark.extended
def test_pictures_of_concepts_are_what_the_script_draws() -> None:
    drawn = tool("make_pictures").pictures()
    kept = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "concepts").glob("*.svg")}
    assert sorted(drawn) == sorted(kept)
    differing = [name for name in drawn if drawn[name] != kept[name]]
    assert not differing, "run: python tools/make_pictures.py"
    text = "\n".join((ROOT / "docs" / page).read_text(encoding="utf-8") for page in PAGES if page.startswith("concepts/"))
    assert [name for name in kept if f"({name}.svg)" not in text] == []


@pytest.mark.extended
def test_the_gallery_shows_what_its_tests_do(tmp_path: Path) -> None:
    gallery = tool("make_gallery")
    page = gallery.PAGE.read_text(encoding="utf-8")
    wanted = gallery.failures(page)
    assert len(wanted) == page.count("\n## ") == page.count("<!-- replay: ")
    assert all(f"$ pytest --tb=short test_{failure.name.replace('-', '_')}.py" in page for failure in wanted)
    assert gallery.make(page, tmp_path) == []
    assert sorted(path.stem for path in tmp_path.iterdir()) == sorted(failure.name for failure in wanted)
    for failure in wanted:
        replay = (tmp_path / f"{failure.name}.html").read_text(encoding="utf-8")
        said = failure.printed[0].partition(": ")[2].partition(" (the first")[0]
        assert said in replay
        assert "start     " in replay


@pytest.mark.extended
def test_outdated_gallery_is_refused(tmp_path: Path) -> None:
    gallery = tool("make_gallery")
    section = gallery.PAGE.read_text(encoding="utf-8").split("\n## ")[1]
    changed = section.replace("at t=5.21 s", "at t=9.99 s")
    (told,) = gallery.make(f"# x\n\n## {changed}", tmp_path)
    assert told.startswith("rolls-over-the-line: pytest does not print 'E   pytest_rvads.RuleViolation: full_stop at t=9.99 s")
    mended = section.replace("max(2.0, self.stopping_speed(ahead)) if ahead > 0 else 6.0", "self.stopping_speed(ahead - 0.5)")
    assert gallery.make(f"# x\n\n## {mended}", tmp_path) == ["rolls-over-the-line: its test did not fail"]


@pytest.mark.parametrize(
    ("source", "markdown", "shown"),
    [
        ("town.md", "[s](../SECURITY.md#a)", "[s](SECURITY.md#a)"),
        ("concepts/zones.md", "[s](../../SECURITY.md)", "[s](../SECURITY.md)"),
        ("concepts/zones.md", "[r](../rules.md)", "[r](../rules.md)"),
        ("town.md", "[e](../examples/conftest.py)", "[e](https://host/p/blob/main/examples/conftest.py)"),
        ("town.md", "[e](../examples)", "[e](https://host/p/tree/main/examples)"),
        ("SECURITY.md", "[d](docs/town.md#a)", "[d](town.md#a)"),
        ("SECURITY.md", "[d](README.md)", "[d](https://host/p/blob/main/README.md)"),
        ("town.md", "[x](https://example.org/a.md) [y](#here)", "[x](https://example.org/a.md) [y](#here)"),
        (
            "town.md",
            "`[s](../SECURITY.md)`\n```\n[s](../SECURITY.md)\n```",
            "`[s](../SECURITY.md)`\n```\n[s](../SECURITY.md)\n```",
        ),
        ("town.md", "[no](../nothing.md)", "[no](../nothing.md)"),
    ],
)
def test_links_that_leave_the_folder_work_on_the_site(hooks: ModuleType, source: str, markdown: str, shown: str) -> None:
    known = {"town.md", "rules.md", "SECURITY.md", "concepts/zones.md", "README.md"}
    assert hooks.linked(markdown, source, known, "https://host/p") == shown


def test_tables_show_bars_in_code_as_bars(hooks: ModuleType) -> None:
    text = "| `a \\| b` | c \\| d |\n`e \\| f`"
    assert hooks.piped(text) == "| `a | b` | c \\| d |\n`e \\| f`"


def test_replays_are_framed_from_two_seconds_before_their_failure_on(hooks: ModuleType) -> None:
    """The failure is the one that stands nearest above; none begins before the run does."""
    text = "p1 at t=9.00 s: x\np2 at t=5.21 s: y\n<!-- replay: rolls -->\np3 at t=1.50 s: z\n<!-- replay: runs -->"
    assert re.findall(r'<iframe class="replay" src="([^"]+)"', hooks.framed(text)) == [
        "gallery/rolls.html#t=3.21",
        "gallery/runs.html#t=0.00",
    ]
    assert hooks.framed("<!-- another comment -->") == "<!-- another comment -->"


def test_pages_made_from_the_code_hold_every_option_and_command(hooks: ModuleType, pytester: pytest.Pytester) -> None:
    told = pytester.runpytest("--rvads-help").stdout.str()
    offered = set(re.findall(r"^  (--rvads-[a-z-]*[a-z])", told, re.MULTILINE))
    rows = re.findall(r"^## (--rvads-[a-z-]+)\n\n`\1=[^`]+`, in the ini file `(rvads_\w+)`, ", hooks.options(), re.MULTILINE)
    assert {flag for flag, _ in rows} == offered
    assert all(ini == flag.removeprefix("--").replace("-", "_") for flag, ini in rows)
    commands = re.findall(r"^## rvads ([\w-]+)$", hooks.commands(), re.MULTILINE)
    assert {"map", "check", "town", "report", "docs", "classes", "paper"} < set(commands)
    assert "### rvads report merge" in hooks.commands()
