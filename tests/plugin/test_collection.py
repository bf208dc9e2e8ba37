"""Marks expand into items with stable ids, selectable by -k and -m."""

from textwrap import dedent

import pytest

from .conftest import Lines

Names = Lines

RULES = """
    import pytest_rvads as rvads

    @rvads.scenario("stop4", {arguments})
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""


def collect(pytester: pytest.Pytester, arguments: str, *options: str) -> pytest.RunResult:
    pytester.makepyfile(RULES.format(arguments=arguments))
    return pytester.runpytest("--collect-only", "-q", *options)


def test_ids_of_items_are_stable(pytester: pytest.Pytester, brackets: Names) -> None:
    # Written down by hand after `scenarios/ids.py`: ids key --lf, durations and dashboards, so they never change.
    result = collect(pytester, 'scenarios=("2111", "1233"), cover="rotation", grid="D", rules=("p1", "p3")')
    assert brackets(result) == [
        f"stop4-{stem}-{rule}"
        for stem in (
            "class02-as2111-cfgD",
            "class02-as1211-cfgD.r1",
            "class02-as1121-cfgD.r2",
            "class02-as1112-cfgD.r3",
            "class13-as1233-cfgD",
            "class13-as3123-cfgD.r1",
            "class13-as3312-cfgD.r2",
            "class13-as2331-cfgD.r3",
        )
        for rule in ("p1", "p3")
    ]


def test_explicit_values_in_ids(pytester: pytest.Pytester, brackets: Names) -> None:
    result = collect(pytester, 'classes=7, distances=[5, (20, 20, 0.3, 0.3)], speeds=1.5, probe=True, rules="p2"')
    assert brackets(result) == [
        "stop4-class07-as1133-cfgd05.00v01.50-p2",
        "stop4-class07-as1133-cfgd20.00_20.00_00.30_00.30v01.50-p2",
    ]


def test_arrays_and_numbers_of_numpy_are_taken_as_lists_and_numbers(pytester: pytest.Pytester, brackets: Names) -> None:
    arguments = "classes={}, distances={}, speeds={}, probe=True, rules='p2'"
    plain = brackets(collect(pytester, arguments.format("[6, 7]", "[5, 8]", "[(0, 1, 2, 3), 4.5]")))
    assert len(plain) == 2 * 2 * 2
    arrays = ("np.arange(6, 8)", "np.array([5.0, 8.0])", "[np.arange(4), np.float32(4.5)]")
    pytester.makepyfile("import numpy as np\n" + dedent(RULES).format(arguments=arguments.format(*arrays)))
    assert brackets(pytester.runpytest("--collect-only", "-q")) == plain
    one = arguments.format("np.int64(7)", "np.int64(5)", "0")
    pytester.makepyfile("import numpy as np\n" + dedent(RULES).format(arguments=one))
    assert brackets(pytester.runpytest("--collect-only", "-q")) == ["stop4-class07-as1133-cfgd05.00v00.00-p2"]


@pytest.mark.parametrize(("cover", "count"), [("class", 24), ("scenario", 81), ("rotation", 96)])
def test_covers(pytester: pytest.Pytester, cover: str, count: int, brackets: Names) -> None:
    listed = brackets(collect(pytester, f'cover="{cover}", grid="C", rules="p1"'))
    assert len(listed) == count
    assert len({name.split("-")[2] for name in listed}) == (24 if cover == "class" else 81)


def test_defaults_are_the_paper(pytester: pytest.Pytester, brackets: Names) -> None:
    listed = brackets(collect(pytester, ""))
    assert len(listed) == 24 * 5 * 3
    assert {name.rpartition("-")[2] for name in listed} == {"p1", "p2", "p3"}
    assert [name.rpartition("-")[2] for name in listed[:3]] == ["p1", "p2", "p3"], "the rule is the innermost axis"


def test_options_set_the_defaults(pytester: pytest.Pytester, brackets: Names) -> None:
    assert len(brackets(collect(pytester, 'rules="p1"', "--rvads-cover=scenario", "--rvads-grid=CD"))) == 162
    pytester.makeini("[pytest]\nrvads_grid = D\nrvads_cover = rotation\n")
    assert len(brackets(collect(pytester, 'rules="p1"'))) == 96
    assert len(brackets(collect(pytester, 'rules="p1"', "--rvads-cover=class"))) == 24, "the flag wins over the ini"


def test_selection_by_keyword(pytester: pytest.Pytester, brackets: Names) -> None:
    listed = brackets(collect(pytester, 'grid="CD"', "-k", "stop4 and class07"))
    assert len(listed) == 6
    assert all("-class07-" in name for name in listed)


def test_exact_selection_by_mark(pytester: pytest.Pytester, brackets: Names) -> None:
    listed = brackets(collect(pytester, 'grid="CD"', "-m", "rvads(junction='stop4', cls=7, cfg='D', rule='p1')"))
    assert listed == ["stop4-class07-as1133-cfgD-p1"]


@pytest.mark.parametrize("expression", ["not rvads(clas=7)", "slow or (rvads(cls=7) and not rvads (rule='x', clas=7))"])
def test_unknown_key_of_the_selection_by_mark_is_refused(pytester: pytest.Pytester, expression: str) -> None:
    result = collect(pytester, 'grid="C"', "-m", expression)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["ERROR: -m rvads(...) selects by junction, cls, *, got 'clas'; did you mean 'cls'?"])


def test_quoted_values_of_the_selection_by_mark_are_no_keys(pytester: pytest.Pytester) -> None:
    assert collect(pytester, 'grid="C"', "-m", "not rvads(rule='p(x=1)')").ret == pytest.ExitCode.OK


def test_a_test_without_rule_has_an_item_per_run(pytester: pytest.Pytester, brackets: Names) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop3", grid="C")
        def test_run(run): ...
        """
    )
    listed = brackets(pytester.runpytest("--collect-only", "-q"))
    assert listed == [f"stop3-class0{n}-as{s}-cfgC" for n, s in enumerate(("111", "112", "122", "222"), start=1)]


def test_marks_stack_and_the_nearest_level_counts(pytester: pytest.Pytester, ids: Names) -> None:
    pytester.makepyfile(
        """
        import pytest
        import pytest_rvads as rvads

        pytestmark = rvads.scenario("stop3", grid="C", classes=1)

        def test_module(run): ...

        @rvads.scenario("stop4", grid="C", classes=2)
        class TestClass:
            def test_class(self, run): ...

            @rvads.scenario("light4", grid="H", classes=3)
            @rvads.scenario("light3", grid="H", classes=4)
            @pytest.mark.parametrize("x", ["a", "b"])
            def test_function(self, run, x): ...
        """
    )
    names = [name.partition("::")[2] for name in ids(pytester.runpytest("--collect-only", "-q"))]
    assert sorted(names) == sorted(
        [
            "test_module[stop3-class01-as111-cfgC]",
            "TestClass::test_class[stop4-class02-as1112-cfgC]",
            *(
                f"TestClass::test_function[{scenario}-{x}]"
                for x in "ab"
                for scenario in ("light3-class04-as222-cfgH", "light4-class03-as1113-cfgH")
            ),
        ]
    )


def test_items_carry_only_builtins_in_their_mark(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RULES.format(arguments='classes=1, grid="C"'))
    items, _ = pytester.inline_genitems()
    for item in items:
        mark = item.get_closest_marker("rvads")
        assert mark is not None
        assert {type(v) for v in mark.kwargs.values()} <= {str, int}
        assert set(mark.kwargs) == {"junction", "cls", "scenario", "cfg", "rotation", "rule"}


@pytest.mark.extended
def test_too_many_items_are_refused_with_a_remedy(pytester: pytest.Pytester) -> None:
    result = collect(pytester, 'cover="scenario"', "--rvads-max-items=1000")
    assert result.ret == pytest.ExitCode.INTERRUPTED
    result.stdout.fnmatch_lines(
        ["*would expand to 1,215 items (81 scenarios × 5 points × 3 rules): narrow the grid, use --rvads-cover=class, run some*"]
    )
