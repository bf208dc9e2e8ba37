"""Books of rules and vocabularies are values: what is added to one changes no other, and rules hold the words they use."""

import pickle
from collections.abc import Callable
from functools import partial, reduce
from types import FunctionType
from typing import Any, NamedTuple, cast

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.logic.check import check
from pytest_rvads.logic.rules.book import SHIPPED, RuleBook, current_book, get_rule, predicate, rule, rules_for
from pytest_rvads.logic.rules.current import own_desk
from pytest_rvads.logic.rules.rule import Rule, parse
from pytest_rvads.logic.rules.vocabulary import Word, same
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.live.rule_monitor import RuleMonitor
from pytest_rvads.support.errors import FormulaError

Make = Callable[..., Run]


def early(run: Run, agent: int) -> np.ndarray:
    """Whether a state is one of the first ten; a function of a module, so that a process can be sent it."""
    return np.arange(run.steps) < 10


def late(run: Run, agent: int) -> np.ndarray:
    """The opposite."""
    return np.arange(run.steps) >= 10


def test_adding_to_a_book_makes_another_one() -> None:
    mine = Rule("mine", "forall a. F a@j", place="here:1")
    book = RuleBook().add(mine)
    assert (book["mine"], book.own, SHIPPED.own) == (mine, (mine,), ())
    assert book.add(Rule("mine", mine.text, place="there:2"))["mine"].place == "here:1", "the same rule again is no news"
    with pytest.raises(FormulaError, match="'mine' is registered at here:1 and says something else at there:2: give each a name"):
        book.add(Rule("mine", "forall a. G a@j", place="there:2"))
    for name in ("p1", "paper"):
        with pytest.raises(FormulaError, match=f"'{name}' is a shipped rule or rulebook"):
            book.add(Rule(name, mine.text))
    with pytest.raises(FormulaError, match="unknown rule 'mine'"):
        SHIPPED["mine"]


def test_a_book_is_passed_to_whoever_looks_names_up(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200)}, 300)
    book = RuleBook().add(Rule("mine", "forall a. F a@j"))
    assert check(run, "mine", book=book).status == "PASS"
    assert (get_rule("mine", book),) == rules_for("mine", book=book)
    assert RuleMonitor("mine", run.junction, run.agents, book=book).rule is book["mine"]
    for ask in (lambda: check(run, "mine"), lambda: get_rule("mine"), lambda: RuleMonitor("mine", run.junction, run.agents)):
        with pytest.raises(FormulaError, match="unknown rule 'mine'"):
            ask()


def test_companion_rules_come_from_the_book(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 10, 40, 200)}, 300)
    lonely = Rule("lonely", get_rule("p2").text, bound=("a'",), about=get_rule("p2").about, companions=("other",))
    with pytest.raises(FormulaError, match="unknown rule 'other'"):
        check(run, Rule("fails", "forall a. G !a@j", companions=("other",)))
    assert check(run, lonely, book=RuleBook().add(Rule("other", get_rule("p3").text))).status == check(run, "p2").status


def test_registration_goes_to_the_open_book() -> None:
    before = current_book()
    with own_desk() as session:
        made = rule("mine", "forall a. F a@j")
        predicate("early", "agent")(early)
        assert session.book.own == current_book().own == (made,)
        assert made.place.startswith(__file__)
        with own_desk():
            assert get_rule("mine") is made, "a session begins with what the process had"
            rule("yours", "forall a. F a@j")
        assert "yours" not in current_book().rules
    assert current_book() is before
    with pytest.raises(FormulaError, match="unknown predicate 'early'"):
        Rule("x", "forall a. G early(a)")


def test_a_rule_holds_its_words(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200)}, 300)
    with own_desk():
        predicate("soon", "agent")(early)
        one = rule("one", "forall a. G(soon(a) -> !a@j)")
    with own_desk():
        predicate("soon", "agent")(late)
        other = Rule("one", one.text)
    assert (check(run, one).status, check(run, other).status) == ("PASS", "FAIL"), "each as it was meant"
    assert one != other
    assert one.formula != other.formula
    assert [word.holds for word in (*one.words, *other.words)] == [early, late]
    assert check(run, pickle.loads(pickle.dumps(other))).status == "FAIL"
    assert pickle.loads(pickle.dumps(one)) == one
    for name in SHIPPED.rules:
        assert pickle.loads(pickle.dumps(get_rule(name))) == get_rule(name)


def test_a_word_of_another_meaning_is_refused() -> None:
    word = Word("soon", ("agent",), early, place="here:1")
    book = RuleBook().define(word)
    assert book.define(Word("soon", ("agent",), early, place="there:2")).vocabulary["soon"] is word
    assert "soon" not in SHIPPED.vocabulary
    assert len(book.vocabulary) == len(SHIPPED.vocabulary) + 1
    for other in (
        Word("soon", ("agent",), late, place="there:2"),
        Word("soon", ("agent", "agent"), early, place="there:2"),
        Word("soon", ("agent",), early, "{0} is soon", place="there:2"),
    ):
        with pytest.raises(FormulaError, match="'soon' is registered at here:1 and says something else at there:2"):
            book.define(other)
    formula = parse("forall a. G soon(a)", book.vocabulary)
    assert parse(str(formula), book.vocabulary) == formula
    with pytest.raises(FormulaError, match="unknown predicate 'soon'"):
        parse("forall a. G soon(a)")


REGISTERED = """
LIMIT = {limit}


def limit():
    return LIMIT


def fast(run, agent):
    return run.speed[:, agent] > limit()
"""


def loaded(limit: float, lines: int = 0) -> Callable[..., np.ndarray]:
    """Return the predicate of a file, `lines` further down, each time loaded anew."""
    module: dict[str, Any] = {}
    exec(compile("\n" * lines + REGISTERED.format(limit=limit), f"test_{limit}.py", "exec"), module)
    return cast("Callable[..., np.ndarray]", module["fast"])


def over(limit: float) -> Callable[..., np.ndarray]:
    def fast(run: Run, agent: int) -> np.ndarray:
        return run.speed[:, agent] > limit

    return fast


def packed(package: str, body: str = "from .limits import K as limit") -> Callable[..., np.ndarray]:
    """Return a predicate of a module in a package."""
    module: dict[str, Any] = {"__package__": package}
    exec(f"def fast(run, agent):\n    {body}\n    return run.speed[:, agent] > limit\n", module)
    return cast("Callable[..., np.ndarray]", module["fast"])


def deep(functions: int) -> Callable[..., np.ndarray]:
    """Return a function that works with a function, and so on."""
    return reduce(lambda inner, _: over(inner), range(functions), over(3))  # type: ignore[arg-type]


class Over:
    """A limit with a method that asks whether it is kept."""

    def __init__(self, limit: float) -> None:
        self.limit = limit

    def fast(self, run: Run, agent: int) -> np.ndarray:
        return run.speed[:, agent] > self.limit


class Kilometres(float):
    """No plain number: it may have methods and attributes."""


class Limits(NamedTuple):
    """Likewise."""

    low: float


@pytest.mark.parametrize("limits", [(300, 3), (3, 300)])
@pytest.mark.parametrize(
    "predicate_of",
    [
        over,
        lambda limit: Over(limit).fast,
        loaded,
        lambda limit: lambda run, agent, over=limit: run.speed[:, agent] > over,
        lambda limit: lambda run, agent: run.speed[:, agent] > (lambda: limit)(),
    ],
    ids=["closure", "method", "global", "default", "nested"],
)
def test_no_rule_is_judged_by_the_predicate_of_another(
    drive: Make, predicate_of: Callable[[float], Callable[..., np.ndarray]], limits: tuple[float, float]
) -> None:
    """The predicates have one code, the rules one text."""
    run = drive("stop4", {0: (2, -20, [(0, 10.0)])}, 30)
    statuses = {}
    for limit in limits:
        word = Word("fast", ("agent",), predicate_of(limit))
        statuses[limit] = check(run, Rule(f"under{limit}", "forall a. G !fast(a)", words=(word,))).status
    assert statuses == {300: "PASS", 3: "FAIL"}


def test_a_rule_asks_its_own_function_also_where_another_one_is_alike(drive: Make) -> None:
    """They may come to differ: here a global is bound again after both were found to say the same."""
    run = drive("stop4", {0: (2, -20, [(0, 10.0)])}, 30)
    functions = [loaded(300), loaded(300)]
    one, two = (Rule("own", "forall a. G !fast(a)", words=(Word("fast", ("agent",), function),)) for function in functions)
    assert one == two
    functions[1].__globals__["LIMIT"] = 3
    assert (check(run, one).status, check(run, two).status) == ("PASS", "FAIL")
    assert one != two


def recursive(depth: int) -> bool:
    return depth == 0 or recursive(depth - 1)


def test_functions_are_equal_by_code_and_values() -> None:
    owner = Over(3)
    alike = [
        (loaded(3), loaded(3)),
        (loaded(3), loaded(3, lines=9)),
        (over(3), over(3)),
        (over((3, "m")), over((3, "m"))),  # type: ignore[arg-type]
        (over(loaded(3)), over(loaded(3))),  # type: ignore[arg-type]
        (owner.fast, owner.fast),
        (packed("one"), packed("one")),
        (packed("one", "limit = 3"), packed("two", "limit = 3")),
        (recursive, FunctionType(recursive.__code__, globals(), "again")),
    ]
    assert [same(one, two) for one, two in alike] == [True] * len(alike)
    tagged = loaded(3)
    tagged.unit = "m/s"  # type: ignore[attr-defined]
    apart = [
        (loaded(3), loaded(4)),
        (loaded(3), loaded(3.0)),
        (loaded(3), tagged),
        (over(3), over(4)),
        (over(Over(3)), over(Over(3))),  # type: ignore[arg-type]
        (over([3]), over([3])),  # type: ignore[arg-type]
        (over(Kilometres(3)), over(Kilometres(3))),
        (over(Limits(3)), over(Limits(3))),  # type: ignore[arg-type]
        (over(loaded(3)), over(loaded(4))),  # type: ignore[arg-type]
        (Over(3).fast, Over(3).fast),
        (early, late),
        (partial(early), partial(early)),
        (packed("one"), packed("two")),
        (packed("one", "limit = globals()['K']"), packed("one", "limit = globals()['K']")),
        (deep(1500), deep(1500)),
    ]
    assert [same(one, two) for one, two in apart] == [False] * len(apart)


def test_a_word_tells_where_it_was_made_and_shipped_ones_stay() -> None:
    fast, slow = Word("fast", ("agent",), early), Word("fast", ("agent",), late)
    line = int(fast.place.rpartition(":")[2])
    told = rf"'fast' is registered at {__file__}:{line} and says something else at {__file__}:{line}: give each a name"
    with pytest.raises(FormulaError, match=told):
        RuleBook().define(fast).define(slow)
    with pytest.raises(FormulaError, match=f"rule 'mine': {told}"):
        Rule("mine", "forall a. G !fast(a)", words=(fast, slow))
    mine = Word("stopped", ("agent",), early)
    for put in (RuleBook().define, lambda word: Rule("mine", "forall a. G !stopped(a)", words=(word,))):
        with pytest.raises(FormulaError, match=rf"'stopped' is a shipped word, not to be changed at {__file__}:\d+"):
            put(mine)


def test_unknown_predicate_of_a_rule_names_the_remedy() -> None:
    with pytest.raises(FormulaError, match="unknown predicate 'zoom': register it before the rule, or give the rule its Word by"):
        RuleBook().define(Word("zoom", ("agent",), early)).add(Rule("mine", "forall a. G zoom(a)"))


def test_book_is_frozen_and_book_argument_takes_only_books(make: Make) -> None:
    run = make("stop4", {0: (2, 10, 50, 200)}, 300)
    known = {"mine": Rule("mine", "forall a. F a@j")}
    book = RuleBook(known)
    known["yours"] = known["mine"]
    assert list(book.rules) == ["mine"]
    assert len({book, RuleBook({"mine": known["mine"]}), SHIPPED}) == 2
    for names in (book.rules, book.vocabulary):
        with pytest.raises(TypeError, match="does not support item assignment"):
            names["zz"] = 3  # type: ignore[index]
    wrong: Any = {}
    for ask in (
        lambda: check(run, "p1", book=wrong),
        lambda: check(run, get_rule("p1"), book=wrong),
        lambda: rules_for("p1", book=wrong),
        lambda: RuleMonitor("p1", run.junction, run.agents, book=wrong),
    ):
        with pytest.raises(FormulaError, match=r"book= takes a RuleBook, or nothing for the one that is open, got {}"):
            ask()


def test_words_of_a_predicate_name_its_arguments() -> None:
    with pytest.raises(FormulaError, match=r"'near': words name its 1 arguments by number, \{0\} the first, got '\{1\} is near'"):
        rvads.predicate("near", "agent", says="{1} is near")
    with pytest.raises(FormulaError, match=r"got '\{0 is near'"):
        rvads.predicate("near", "agent", denies="{0 is near")
    for says in ("{0.z}", "{0[z]}", 3):
        with pytest.raises(FormulaError, match="'near': words name its 1 arguments by number"):
            Word("near", ("agent",), says=says)  # type: ignore[arg-type]


def test_arguments_of_wrong_type_are_refused_by_books() -> None:
    wrong: Any = 3
    for ask, told in (
        (lambda: Word(wrong, ("agent",)), "a predicate needs a free identifier as its name, got 3"),
        (lambda: RuleBook({"a": wrong}), "rules= takes rules by their names, got 3"),
        (lambda: RuleBook(wrong), "rules= takes rules by their names, got 3"),
        (lambda: RuleBook(vocabulary=wrong), "vocabulary= takes a Vocabulary, got 3"),
        (lambda: rules_for(wrong), "rules are named one by one, or as a list of names and of Rules, got 3"),
    ):
        with pytest.raises(FormulaError, match=told):
            ask()
