"""Write docs/REFERENCE.md, every public name of the package, from its docstrings. `make docs`."""

import ast
import inspect
import re
from pathlib import Path

import simaps_viz
from simaps_viz.io.files import write_whole

PAGE = Path(__file__).parents[1] / "docs" / "REFERENCE.md"
HEAD = """# Every public name

All of it is importable from `simaps_viz`. `make docs` writes this page from the docstrings, and a test says when it is
out of date. [API.md](API.md) is the guide.
"""


def entry(title: str, signature: str, docstring: str | None) -> str:
    """Return one entry: a heading, the signature and the docstring, sections such as Args as they stand."""
    text, _, sections = inspect.cleandoc(docstring or "").partition("\n\n")
    rest = f"\n\n```text\n{sections}\n```" if sections else ""
    return f"{title}\n\n```python\n{signature}\n```\n\n{' '.join(text.split())}{rest}\n"


def header(node: ast.FunctionDef) -> str:
    """Return a function's first line as it is written, decorators before it."""
    marks = "".join(f"@{ast.unparse(mark)}\n" for mark in node.decorator_list)
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return re.sub(r"'(\w[^']*)'", r"\1", f"{marks}{node.name}({ast.unparse(node.args)}){returns}")


def fields(body: list[ast.stmt]) -> list[str]:
    """Return a paragraph with a line for every public field and the docstring under it; none, if there is none."""
    lines: list[str] = []
    for node, after in zip(body, [*body[1:], ast.Pass()], strict=True):
        if isinstance(node, ast.AnnAssign) and not ast.unparse(node.target).startswith("_"):
            said = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else ""
            lines.append(f"- `{ast.unparse(node)}`" + (f": {' '.join(str(said).split())}" if said else ""))
    return ["\n".join(lines) + "\n"] * bool(lines)


def describe(name: str) -> str:
    """Return the entries of a public function or class, with its fields and public methods."""
    tree = ast.parse(inspect.getsource(getattr(simaps_viz, name))).body[0]
    if isinstance(tree, ast.FunctionDef):
        return entry(f"## `{name}`", header(tree), ast.get_docstring(tree))
    assert isinstance(tree, ast.ClassDef)
    methods = [node for node in tree.body if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")]
    bases = f"({', '.join(map(ast.unparse, tree.bases))})" if tree.bases else ""
    parts = [entry(f"## `{name}`", f"class {name}{bases}", ast.get_docstring(tree)), *fields(tree.body)]
    return "\n".join(parts + [entry(f"### `{name}.{m.name}`", header(m), ast.get_docstring(m)) for m in methods])


def page() -> str:
    """Return the whole page."""
    return "\n".join([HEAD, *map(describe, sorted(simaps_viz.__all__, key=str.lower))])


if __name__ == "__main__":
    write_whole(PAGE, page().encode(), "the reference")
