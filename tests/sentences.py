"""Finds code that decides by what a sentence says: Python by its syntax, the rest by the line."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

SENTENCES = {
    *("text", "reason", "message", "termination", "summary", "said", "why"),
    *("note", "notes", "implausible", "unobservable", "troubles", "over"),
}
"""Attributes and keys of results that hold sentences, or lists of them."""

HARMLESS = {
    *("format", "join", "encode", "expandtabs", "strip", "lstrip", "rstrip", "splitlines"),
    *("capitalize", "title", "upper", "lower", "casefold", "center", "ljust", "rjust", "zfill"),
}
"""Methods of text that lay it out. What they return is still a sentence."""

LOOKS = {name for name in dir(str) if not name.startswith("_")} - HARMLESS | {
    "__contains__",
    "__eq__",
}
"""Methods that look into text."""

SEARCHES = {
    *("search", "match", "fullmatch", "findall", "finditer", "sub", "subn", "split"),
    *("contains", "eq", "ne", "countOf", "indexOf", "fnmatch", "get"),
}
"""Functions of `re`, `operator` and `fnmatch`, and of tables, that do so with an argument."""

KEEPS = {
    "str",
    "list",
    "tuple",
    "set",
    "sorted",
    "reversed",
    "iter",
    "next",
    "filter",
    "min",
    "max",
}
"""Functions of which the result is of sentences where an argument is."""

OF_ONE_MEANING = SENTENCES - {"text", "message", "said", "summary", "why"}
"""What a parameter is called only where it is a sentence of a result."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def is_key(node: ast.AST) -> bool:
    """Whether a constant names an entry that holds a sentence."""
    return isinstance(node, ast.Constant) and node.value in SENTENCES


class Sentences:
    """Which expressions of a function are sentences, those that local names stand for included.

    `given` are the parameters that callers give sentences for.
    """

    def __init__(self, scope: ast.AST, given: frozenset[str] = frozenset()) -> None:
        self.scope, self.given = scope, given
        self.names = set(given)
        while True:  # a name may stand for another one
            known = len(self.names)
            for target, value in self._bound():
                self._bind(target, value)
            if len(self.names) == known:
                break

    def _bound(self) -> Iterator[tuple[ast.AST, ast.AST]]:
        """Each name with what it stands for; of a loop, with what is looped over."""
        for node in own_nodes(self.scope):
            if isinstance(node, ast.Assign):
                yield from ((target, node.value) for target in node.targets)
            elif isinstance(node, ast.AnnAssign | ast.AugAssign) and node.value is not None:
                yield node.target, node.value
            elif isinstance(node, ast.NamedExpr):
                yield node.target, node.value
            elif isinstance(node, ast.For | ast.AsyncFor | ast.comprehension):
                yield node.target, each_of(node.iter)
            elif isinstance(node, ast.Match):
                yield from ((case.pattern, node.subject) for case in node.cases)
            elif isinstance(node, ast.Call):
                given = [*node.args, *(k.value for k in node.keywords)]
                for function in (one for one in given if isinstance(one, ast.Lambda)):
                    names = [ast.Name(argument.arg) for argument in function.args.args]
                    yield from ((name, own) for name in names for own in node.args)

    def _bind(self, target: ast.AST, value: ast.AST) -> None:
        if isinstance(target, ast.Name) and self.holds(value):
            self.names.add(target.id)
        elif isinstance(target, ast.Starred):
            self._bind(target.value, value)
        elif isinstance(target, ast.MatchAs) and target.name and self.holds(value):
            self.names.add(target.name)
        elif isinstance(target, ast.Tuple | ast.List):
            if isinstance(value, ast.Tuple | ast.List) and len(value.elts) == len(target.elts):
                for one, own in zip(target.elts, value.elts, strict=True):
                    self._bind(one, own)

    def holds(self, node: ast.AST) -> bool:
        """Whether an expression is a sentence, or holds some, by its name."""
        match node:
            case ast.Name():
                return node.id in self.names
            case ast.Attribute():
                of_noise = node.attr == "source" and ast.unparse(node.value).endswith("noise")
                return node.attr in SENTENCES or of_noise
            case ast.Subscript():
                return is_key(node.slice) or self.holds(node.value)
            case ast.Call(func=ast.Name(id="getattr")):
                return len(node.args) > 1 and is_key(node.args[1])
            case ast.Call(func=ast.Name(id=name)):
                return name in KEEPS and any(map(self.holds, node.args))
            case ast.Call(func=ast.Attribute() as function):
                entry = function.attr in ("get", "pop") and node.args and is_key(node.args[0])
                returned = function.attr in HARMLESS | LOOKS and self.holds(function.value)
                return bool(entry) or returned or function.attr in OF_ONE_MEANING
            case ast.BoolOp() | ast.JoinedStr() | ast.Tuple() | ast.List() | ast.Set():
                inner = node.elts if hasattr(node, "elts") else node.values  # type: ignore[attr-defined]
                return any(map(self.holds, inner))
            case ast.IfExp():
                return self.holds(node.body) or self.holds(node.orelse)
            case ast.BinOp():
                return self.holds(node.left) or self.holds(node.right)
            case ast.ListComp() | ast.SetComp() | ast.GeneratorExp():
                return self.holds(node.elt)
            case ast.NamedExpr() | ast.FormattedValue() | ast.Starred():
                return self.holds(node.value)
        return False

    def looked_at(self, node: ast.AST) -> list[ast.AST]:
        """The expressions that a node looks into."""
        match node:
            case ast.Compare():
                every = [node.left, *node.comparators]
                nothing = any(isinstance(n, ast.Constant) and n.value is None for n in every)
                # What was printed is no fact: it is compared so that nothing is said twice.
                printed = "._said" in ast.unparse(node)
                return [] if nothing or printed else every
            case ast.Match():
                literal = (ast.MatchValue, ast.MatchOr, ast.MatchSequence)
                guarded = [case.pattern for case in node.cases]
                looks = any(isinstance(n, literal) for p in guarded for n in ast.walk(p))
                return [node.subject] if looks else []
            case ast.Subscript(ctx=ast.Load()):
                return [node.slice]
            case ast.Call(func=ast.Attribute() as function):
                looks = function.attr in LOOKS and not self._lays_out(node, function)
                own = [function.value] if looks else []
                of_class = isinstance(function.value, ast.Name) and function.value.id == "str"
                inside = function.attr in SEARCHES or (of_class and function.attr in LOOKS)
                return own + (list(node.args) if inside else [])
            case ast.Call(func=ast.Name(id=name)):
                return list(node.args) if name in SEARCHES else []
        return []

    def _lays_out(self, call: ast.Call, function: ast.Attribute) -> bool:
        """Whether a call breaks a sentence into words, or makes it fit for a file."""
        if function.attr == "split":
            return not call.args and not call.keywords
        # What marks an end in a file must not stand in a sentence: a function that returns text.
        made = getattr(self.scope, "returns", None)
        of_caller = isinstance(function.value, ast.Name) and function.value.id in self.given
        return function.attr == "replace" and of_caller and ast.unparse(made or call) == "str"

    def lines(self) -> list[int]:
        """Lines on which a sentence is looked into."""
        nodes = [n for n in own_nodes(self.scope) if any(map(self.holds, self.looked_at(n)))]
        return [getattr(n, "lineno", 0) for n in nodes]

    def handed_on(self, functions: dict[str, Function]) -> Iterator[tuple[str, str]]:
        """Functions of the module that are called with a sentence, and the parameter it is."""
        for node in own_nodes(self.scope):
            if not isinstance(node, ast.Call):
                continue
            of_self = isinstance(node.func, ast.Attribute)
            name = node.func.attr if isinstance(node.func, ast.Attribute) else None
            name = node.func.id if isinstance(node.func, ast.Name) else name
            if name is None or name not in functions:
                continue
            names = [a.arg for a in functions[name].args.args]
            first = 1 if of_self and names[:1] == ["self"] else 0
            given = [*zip(names[first:], node.args, strict=False)]
            given += [(k.arg, k.value) for k in node.keywords if k.arg is not None]
            yield from ((name, parameter) for parameter, value in given if self.holds(value))


def own_nodes(scope: ast.AST) -> Iterator[ast.AST]:
    """Nodes of a function, without those of the functions in it."""
    for child in ast.iter_child_nodes(scope):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        yield child
        yield from own_nodes(child)


def each_of(value: ast.AST) -> ast.AST:
    """What a loop has in its turn: of `enumerate` and `zip`, one of each."""
    match value:
        case ast.Call(func=ast.Name(id="enumerate"), args=[first, *_]):
            return ast.Tuple([ast.Constant(0), first])
        case ast.Call(func=ast.Name(id="zip"), args=several):
            return ast.Tuple(several)
    return value


def looked_into(source: str) -> list[int]:
    """Lines of a module of Python in which a sentence is compared or searched."""
    tree = ast.parse(source)
    every = [n for n in ast.walk(tree) if isinstance(n, Function)]
    named = {f.name: f for f in every}
    given = {name: {a.arg for a in f.args.args} & OF_ONE_MEANING for name, f in named.items()}
    while True:
        scopes = [Sentences(tree), *(Sentences(f, frozenset(given[f.name])) for f in every)]
        new = {found for scope in scopes for found in scope.handed_on(named)}
        new = {(name, parameter) for name, parameter in new if parameter not in given[name]}
        if not new:
            return sorted({line for scope in scopes for line in scope.lines()})
        for name, parameter in new:
            given[name].add(parameter)


WORDS = rf"(?:{'|'.join(sorted(SENTENCES | {'words'}))})"
METHODS = (
    r"(?:includes|startsWith|endsWith|match|matchAll|search|indexOf|lastIndexOf|split|replace"
    r"|replaceAll|test|exec)"
)
IN_SCRIPTS = (
    # x.text.startsWith("a")
    rf"\b{WORDS}(?:\[\w+\])?\.{METHODS}\(",
    # named.includes(words), /a/.test(x.text)
    rf"\.{METHODS}\((?:\w+\.)*{WORDS}\)",
    # text !== s.order.text
    rf"(?<!\.length )(?:===?|!==?)\s*(?:\w+\.)+{WORDS}\b(?!\s*\.length)",
    rf"\.{WORDS}\s*[!=]==?(?!=|\s*(?:null|undefined)\b)",
    rf"\bswitch\s*\((?:\w+\.)*{WORDS}\)",
)

FIELDS = r"\.(?:text|reason|message|implausible|unobservable|troubles)(?!\()\b"
"""Fields of the core that are sentences; `source` and `termination` are values there."""
INTO = (
    r"(?:starts_with|ends_with|contains|find|rfind|split_once|rsplit_once|strip_prefix|strip_suffix"
    r"|matches|trim_start_matches|trim_end_matches|eq)"
)
CHANGED = r"(?:\[\w+\])?(?:\.(?:as_str|as_deref|as_ref|clone|unwrap_or_default)\(\))*"
IN_THE_CORE = (
    # warned.text.starts_with("a"), warning.to_string().contains("a")
    rf"(?:{FIELDS}{CHANGED}|\.to_string\(\)|\bwords::\w+\(.*\))\.{INTO}\(",
    # warned.text == "a"
    rf"{FIELDS}{CHANGED}\s*[!=]=",
    rf"[!=]=\s*&?(?:\w+\.)*\w+{FIELDS}",
    # match warned.text.as_str() {
    rf"\bmatch\s[^{{=]*{FIELDS}{CHANGED}\s*\{{",
)


def by_line(source: str, rules: tuple[str, ...]) -> list[int]:
    """Lines that match one of the rules, comments left out.

    What an element of a page says at present (`dataset.said`) is no fact: it is compared so that
    nothing is said twice.
    """
    return [
        number
        for number, line in enumerate(source.splitlines(), start=1)
        if not line.lstrip().startswith("//")
        and "dataset.said" not in line
        and any(re.search(rule, line) for rule in rules)
    ]
