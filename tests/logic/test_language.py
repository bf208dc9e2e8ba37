"""The language of rules: spellings, printing, sorts, errors with a caret and the nearest valid word."""

import pytest

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.parser import DEPTH_LIMIT, LENGTH_LIMIT, SIZE_LIMIT, parse_ltl, parse_rule
from pytest_rvads.logic.rules.book import rulebook
from pytest_rvads.logic.rules.rule import parse
from pytest_rvads.logic.rules.vocabulary import LANGUAGE, Sort
from pytest_rvads.support.errors import FormulaError


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("[] (p -> <> q)", "G (p -> F q)"),
        ("□ (p → ◇ q)", "G (p => F q)"),
        ("p && q || r", "(p & q) | r"),
        ("p /\\ !q \\/ r", "(p ∧ ¬q) ∨ r"),
        ("X p", "N p"),
        ("○ p", "N p"),
        ("p <=> q", "p <-> q"),
        ("p ^ q", "!(p <-> q)"),
        ("~p", "!p"),
        ("1 & 0", "true & false"),
        ("⊤ U ⊥", "true U false"),
        ("!p U q & r", "((!p) U q) & r"),
        ("p U q U r", "p U (q U r)"),
        ("p W q R r", "p W (q R r)"),
        ("p -> q -> r", "p -> (q -> r)"),
        ("p <-> q <-> r", "(p <-> q) <-> r"),
        ("p | q & r -> s", "(p | (q & r)) -> s"),
        ("a & (b & c)", "(a & b) & c"),
        ("p # a comment\n & q", "p & q"),
        ("[p & q]", "p & q"),
    ],
)
def test_spellings_of_other_tools(one: str, other: str) -> None:
    assert parse_ltl(one) == parse_ltl(other)


@pytest.mark.parametrize(("one", "other"), [("≠", "!="), ("≤", "<="), ("≥", ">=")])
def test_spellings_of_comparisons(one: str, other: str) -> None:
    assert parse(f"forall a. F a.sp {one} 2") == parse(f"forall a. F a.sp {other} 2")


def test_parsed_formula_equals_the_formula_by_hand() -> None:
    """Where a name stands in the text, and whether its letters tell the sort, is for messages and printing only."""
    by_hand = f.Forall((f.Binder("a", Sort.AGENT),), f.Eventually(f.Atom("@", (f.Var("a"), f.Var("j")))))
    assert parse("forall a. F a@j") == parse("forall a: agent. F a@j") == by_hand


def test_any_identifier_is_a_proposition() -> None:
    names = ("t", "f", "r", "tt", "ff", "Gp", "Fx", "Xp", "U2", "not", "and", "forall", "right", "true1", "a.b", "x'", "_")
    for name in names:
        assert parse_ltl(f"!{name}") == f.Not(f.Atom(name))
        assert parse_ltl(f"{name} U {name}") == f.Until(f.Atom(name), f.Atom(name))


@pytest.mark.parametrize(
    "text",
    [
        "forall a, a'. G(a@j & a != a' -> !a'@j)",
        "∀a. ∀a'. □[[a@j ∧ a ≠ a'] → ¬a'@j]",
        "forall x: agent, y: entrance. x@y U x@j",
        "exists a. forall lt. G(lt.cl = red -> !(a.sp >= 0.5))",
        "forall j.en, j.en2, v. j.en right-of j.en2 | j.en opposite j.en2 | v = j.en",
        "forall a, j.ex. F a@j.ex & (exists a'. a'@j)",
        "forall a. (exists a'. a != a' & a'.wt <= a.wt) -> N N a.wt < 3",
        "forall o, j.en, a, r. o@j.en W a@r",
        "near(a, a') := a.sp < a'.sp; forall a, a'. G near(a, a')",
        "# a comment\nforall a.\n  F a@j  # another",
    ],
)
def test_printing_and_parsing_of_rules_are_inverse(text: str) -> None:
    formula = parse(text)
    assert parse(str(formula)) == formula


@pytest.mark.parametrize(
    "text",
    [
        "p & q | r & s -> t <-> u",
        "p -> q -> r",
        "(p -> q) -> r",
        "p <-> q <-> r",
        "p <-> (q <-> r)",
        "p U q U r",
        "(p U q) U r",
        "(p | q) & r",
        "!(p & q) U N !q",
        "G(p -> F q)",
        "G F !p",
        "p W q & (r R s | t)",
        "N N(p U q)",
    ],
)
def test_formulas_print_with_no_bracket_too_many(text: str) -> None:
    assert str(parse_ltl(text)) == text


def test_shipped_rules_print_as_they_are_written() -> None:
    for name in ("paper", "variants", "road"):
        for rule in rulebook(name):
            assert parse(str(rule.formula)) == rule.formula
    p2 = "forall j.en, j.en', a, a'. G(a@j.en & a'@j.en' & a.wt = a'.wt & j.en right-of j.en' -> N a'@j.en' U a@j)"
    assert str(rulebook("paper")[1].formula) == p2


@pytest.mark.parametrize(
    ("name", "sort"),
    [
        ("a", Sort.AGENT),
        ("a''", Sort.AGENT),
        ("a17", Sort.AGENT),
        ("lt'", Sort.LIGHT),
        ("o", Sort.OBJECT),
        ("r2", Sort.ROAD),
        ("j", Sort.JUNCTION),
        ("v", Sort.VERTEX),
        ("j.en'", Sort.ENTRANCE),
        ("j'.ex", Sort.EXIT),
        ("r.en", Sort.VERTEX),
        ("b", None),
        ("a.en", None),
        ("light", None),
    ],
)
def test_letters_tell_the_sort(name: str, sort: Sort | None) -> None:
    assert LANGUAGE.sort_of(name) is sort


def test_definitions_do_not_capture_variables() -> None:
    text = "meets(a) := exists a'. a != a' & a'@j; forall a, a'. G meets(a')"
    assert parse_rule(text, LANGUAGE) == parse_rule("forall a, a'. G(exists a''. a' != a'' & a''@j)", LANGUAGE)
    constants = "slow(a) := a.sp < 2 & turn(a, left); forall a'. G !slow(a')"
    assert parse_rule(constants, LANGUAGE) == parse_rule("forall a'. G !(a'.sp < 2 & turn(a', left))", LANGUAGE)
    nested = "one(a) := a@j; two(a, a') := one(a) & one(a'); forall a, a'. G !two(a, a')"
    assert parse_rule(nested, LANGUAGE) == parse_rule("forall a, a'. G !(a@j & a'@j)", LANGUAGE)


ERRORS = [
    ("forall a. G(a@j", "unexpected the end, expected a closing bracket or an operator", 15),
    ("foral a. G a@j", "unexpected 'foral'; did you mean 'forall'?", 0),
    ("forall a. G a@j)", "unexpected ')', expected an operator or the end", 15),
    ("forall a. G & a@j", "unexpected '&', expected a formula", 12),
    ("forall a. G $", "unexpected '$'", 12),
    ("forall a, red. F a@j", "red is a value, it can't be a variable", 10),
    ("forall b. F b@j", "the letters of b tell no sort: declare one, such as `forall b: agent.`", 7),
    ("forall x: agnt. F x@j", "unknown sort agnt; did you mean 'agent'?", 10),
    ("forall a. G a'@j", "unbound variable a'; did you mean 'a'?", 12),
    ("forall j.en. F a@j.en", "unbound variable a", 15),
    ("forall a. G foo(a)", "unknown predicate 'foo'", 12),
    ("forall a. G trun(a, left)", "unknown predicate 'trun'; did you mean 'turn'?", 12),
    ("forall a. turn(a)", "turn takes 2 arguments (agent, direction), got 1", 10),
    ("forall a, j.en. j.en@a", "expected agent or light or object, got j.en, of sort entrance", 20),
    ("forall a. turn(a, red)", "expected direction, got red, of sort colour", 10),
    ("forall a, lt. a.wt = lt.cl", "can't compare number with colour, both sides must have the same sort", 19),
    ("forall a. a.cl = red", "cl belongs to lights, a is of sort agent", 10),
    ("forall a, a'. a.wt < a'.sp", "can't compare sp with wt", 19),
    ("forall a, a'. a < a'", "can't compare agent with agent, only numbers have an order", 16),
    ("forall a, a'. a.wt = a.wt'", "unknown attribute \"wt'\"; did you mean 'wt'?", 21),
    ("forall a. p", "'p' is neither a formula nor a known predicate", 10),
    ("forall a. not a@j", "unexpected 'not'; did you mean '!'?", 10),
    ("forall a. G(a@j until a@j)", "unexpected 'until'; did you mean 'U'?", 16),
    ("forall a. (a@j) until a@j", "unexpected 'until'; did you mean 'U'?", 16),
    (") a@j", "unexpected ')', expected a formula", 0),
    ("p", "'p' is neither a formula nor a known predicate", 0),
    ("a@j", "unbound variable a", 0),
    ("near(j)", "unknown predicate 'near'", 0),
    ("d(red) := a@j; forall a. d(a)", "the parameters of d must be variables, got red", 0),
    ("d(a) := a@j; e(red) := a@j; forall a. d(a)", "the parameters of e must be variables, got red", 13),
    ("d(a) := a@j; forall a. d(a, a)", "d takes 1 arguments, got 2", 23),
]


@pytest.mark.parametrize(("text", "message", "column"), ERRORS, ids=[e[0] for e in ERRORS])
def test_errors_name_the_place_and_the_nearest_word(text: str, message: str, column: int) -> None:
    with pytest.raises(FormulaError) as caught:
        parse(text)
    first, line, mark = str(caught.value).split("\n")
    assert message in first
    assert line == "  " + text
    assert mark == "  " + " " * column + "^"


def test_propositional_formulas_are_not_told_words_of_rules() -> None:
    for text, message in (("always p", "did you mean 'G'"), ("entx p", "unexpected 'p', expected an operator or the end\n")):
        with pytest.raises(FormulaError) as caught:
            parse_ltl(text)
        assert message in str(caught.value)


@pytest.mark.parametrize(
    ("word", "sign"),
    [
        *(("not", "!"), ("and", "&"), ("or", "|"), ("xor", "^"), ("implies", "->"), ("iff", "<->"), ("next", "N")),
        *(("always", "G"), ("globally", "G"), ("eventually", "F"), ("finally", "F"), ("until", "U"), ("release", "R")),
    ],
)
def test_operators_in_words_are_told_their_signs(word: str, sign: str) -> None:
    with pytest.raises(FormulaError) as caught:
        parse_ltl(f"p & {word} q" if sign in "!NGF" else f"p {word} q")
    assert f"unexpected {word!r}; did you mean {sign!r}?" in str(caught.value)


def test_errors_show_one_line_and_at_most_100_characters() -> None:
    with pytest.raises(FormulaError, match=r"in line 2\n  F \(a@\)\n {7}\^$"):
        parse("forall a.\nF (a@)\n& a@j")
    with pytest.raises(FormulaError, match=r"in line 3\n  G \(a@\)\n {7}\^$"):
        parse("forall a.\nF a@j &\nG (a@)")
    with pytest.raises(FormulaError, match=r"the end\n  forall a\. G a@j\)\n {17}\^$"):
        parse("\nforall a. G a@j)\n")
    with pytest.raises(FormulaError, match=r"^unexpected 'b'\n  forall a b\. F a@b\n {11}\^$"):
        parse("forall a b. F a@b")  # a comma, a colon or a dot: too many to name
    with pytest.raises(FormulaError, match=r"the end, expected a formula\n  \n  \^$"):
        parse("\n")
    with pytest.raises(FormulaError) as caught:
        parse_ltl("p & " * 500 + "& q")
    assert max(map(len, str(caught.value).splitlines())) < 120
    _, line, mark = str(caught.value).splitlines()
    assert line.startswith("  ...")
    assert line[mark.index("^")] == "&", "the caret stands below the second &"
    assert line[: mark.index("^")].endswith("p & ")
    assert line == "  ..." + "p & " * 15 + "& q", "60 characters before the caret"
    with pytest.raises(FormulaError) as caught:
        parse_ltl("p & & q" + " & p" * 500)
    assert str(caught.value).splitlines()[1:] == ["  " + ("p & & q" + " & p" * 500)[:100] + "...", "      ^"]


@pytest.mark.parametrize("grow", ["d{1}(a) & N d{1}(a)", "d{1}(a) & d{1}(a)", "d{1}(a) <-> d{1}(a)", "F (d{1}(a) U d{1}(a))"])
def test_definitions_that_double_are_refused_with_their_size(grow: str) -> None:
    definitions = "".join(f"d{k}(a) := {grow.format(k, k - 1)};\n" for k in range(1, 40))
    with pytest.raises(FormulaError, match=rf"has [0-9,]{{6}} operators and atoms, at most {SIZE_LIMIT:,} are read"):
        parse(f"d0(a) := a@j;\n{definitions}forall a. G d39(a)")


def test_unused_definitions_are_not_expanded() -> None:
    definitions = "".join(f"d{k}(a) := d{k - 1}(a) & N d{k - 1}(a);" for k in range(1, 12))
    assert f.size(parse(f"d0(a) := a@j; {definitions} forall a. G d0(a)")) == 3


def test_a_formula_without_limits_is_refused() -> None:
    with pytest.raises(FormulaError, match=rf"1,000,000 characters, at most {LENGTH_LIMIT:,} are read"):
        parse_ltl("p" * 1_000_000)
    with pytest.raises(FormulaError, match=rf"nests 5001 operators and variables, at most {DEPTH_LIMIT}"):
        parse_ltl("!" * 5000 + "p")
    with pytest.raises(FormulaError, match=r"the formula '!{40}\.\.\.' nests"):
        parse_ltl("!" * 200 + "p")
    assert f.size(parse_ltl("(" * 5000 + "p" + ")" * 5000)) == 1, "brackets alone do no harm"
    with pytest.raises(FormulaError, match="nests 202 operators and variables"):
        parse(f"forall {', '.join(f'a{k}' for k in range(200))}. G a1@j")
    with pytest.raises(FormulaError, match="binds a variable twice"):
        parse("forall a, a. G a@j")
