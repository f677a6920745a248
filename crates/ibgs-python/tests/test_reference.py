"""docs/python-api.md is what the stubs say, and the stubs name what the package has."""

import ast
import os
import re
import textwrap
from pathlib import Path

import ibgs

STUBS = Path(ibgs.__file__).with_name("__init__.pyi")
PAGE = Path(__file__).parents[3] / "docs" / "python-api.md"
HEAD = """# Python reference

Generated from the [stubs](../crates/ibgs-python/python/ibgs/__init__.pyi) of the package by
`IBGS_BLESS=1 cargo test -p ibgs-python`; [python.md](python.md) has examples. Arrays are numpy's, with their shapes in
brackets.
"""


def wrapped(text, later=""):
    """Prose in lines of at most 120 columns, paragraphs apart; lines after the first begin with `later`."""
    wrapper = textwrap.TextWrapper(120, subsequent_indent=later, break_long_words=False, break_on_hyphens=False)
    return "\n\n".join(wrapper.fill(" ".join(paragraph.split())) for paragraph in (text or "").split("\n\n"))


def is_property(node):
    return any(isinstance(decorator, ast.Name) and decorator.id == "property" for decorator in node.decorator_list)


def is_setter(node):
    return any(isinstance(decorator, ast.Attribute) for decorator in node.decorator_list)


def call(node, name):
    """Name, arguments and result of a function as the stubs have them, without `self`."""
    written = textwrap.dedent("\n".join(STUBS.read_text().splitlines()[node.lineno - 1 : node.end_lineno]))
    signature = re.match(r'def \w+(.*?):\s*(?:\.\.\.|""")', written, re.S)[1]
    return (name + re.sub(r"\bself(, |,\n\s*)?", "", signature)).replace("np.", "").removesuffix(" -> None")


def block(node, name):
    return f"```python\n{call(node, name)}\n```"


def function(node, level, name):
    return [f"{'#' * level} {node.name}", block(node, name), wrapped(ast.get_docstring(node))]


def field(name, kind, text):
    kind = ast.unparse(kind).replace("np.", "").replace("'", '"')
    return f"- `{name}`: `{kind}`. {text}" if text else f"- `{name}`: `{kind}`"


def of_class(node):
    """A class: what it is, how it is made, its values in a list, its functions."""
    members = [member for member in node.body if isinstance(member, ast.FunctionDef) and not is_setter(member)]
    parts = [f"## {node.name}", wrapped(ast.get_docstring(node))]
    parts += [block(member, node.name) for member in members if member.name == "__init__"]
    fields = [(member.target.id, member.annotation, None) for member in node.body if isinstance(member, ast.AnnAssign)]
    fields += [(member.name, member.returns, ast.get_docstring(member)) for member in members if is_property(member)]
    parts += ["\n".join(wrapped(field(*each), "  ") for each in fields)]
    for member in members:
        if not is_property(member) and member.name not in ("__init__", "__len__"):
            static = any(ast.unparse(decorator) == "staticmethod" for decorator in member.decorator_list)
            parts += function(member, 3, f"{node.name if static else node.name.lower()}.{member.name}")
    return parts


def page():
    tree, parts, types = ast.parse(STUBS.read_text()), [HEAD.strip()], []
    for node in tree.body:
        if isinstance(node, ast.Assign):
            types += [f"- `{node.targets[0].id}` is `{ast.unparse(node.value)}`."]
        elif isinstance(node, ast.ClassDef):
            parts += of_class(node)
        elif isinstance(node, ast.FunctionDef):
            parts += function(node, 2, f"ibgs.{node.name}")
    parts.insert(1, "\n".join(types).replace("'", '"'))
    return "\n\n".join(part for part in parts if part) + "\n"


def test_the_reference_is_current():
    text = page()
    if "IBGS_BLESS" in os.environ:
        PAGE.write_text(text)
    assert PAGE.read_text() == text, "docs/python-api.md is old; IBGS_BLESS=1 writes it"


def test_the_stubs_name_what_the_package_has():
    def public(names):
        return {name for name in names if not name.startswith("_")}

    stubs = {node.name: node for node in ast.parse(STUBS.read_text()).body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    # Evaluation is the type of a dictionary.
    assert public(stubs) - {"Evaluation"} == public(ibgs.__all__)
    for name in public(ibgs.__all__):
        stub, real = stubs[name], getattr(ibgs, name)
        assert ast.get_docstring(stub) and real.__doc__, name
        if isinstance(stub, ast.ClassDef) and name != "Error":
            members = {member.name for member in stub.body if isinstance(member, ast.FunctionDef)}
            assert public(members) == public(vars(real)), name
