"""Who may import whom, checked from the syntax trees: data flows one way, libraries stay where they belong."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "simaps_viz"

# From the top down. A module may import from lines below its own, and from its own package's modules;
# modules that share a line never import each other.
LINES: list[list[str]] = [
    ["__main__"],
    ["cli", "commands"],
    ["commands.export", "commands.build", "commands.share", "commands.recordings", "commands.doctor"],
    ["page_checks"],
    ["page_checks.pictures", "page_checks.live"],
    ["live"],
    ["page_checks.bench", "page_checks.load", "live.view"],
    ["page_checks.film"],
    ["wiring", "commands.evaluate", "commands.segment", "attacking"],
    ["comparing", "live.build", "looking_back", "sharing"],
    ["commands.options", "building", "mask_services", "commands.mend", "caching", "uploads"],
    ["progress", "tables", "live.pace"],
    ["api"],
    ["exports", "installation"],
    ["viewer", "recorder", "evaluation", "methods", "network_export", "checking"],
    ["cluster"],
    ["navigation.start"],
    ["pipeline", "navigation.agent", "baselines"],
    ["navigation.robot"],
    ["segmentation"],
    ["datasets", "scenes", "mapping", "language", "navigation", "map_colors"],
    ["events", "labels"],
    ["structures"],
    ["geometry", "files", "extras", "arrays", "palette", "remembered", "logs", "stages", "terminal"],
    ["limits"],
    ["errors"],
]

# Methods of SIMap that hand on to functions above: imported when called, or for types only.
UPWARDS = {("structures", "api")}

# The interpreter and the planner are stages of the agent, which alone joins words to ways.
CONFINED = {
    "viser": ["viewer", "attacking.messages"],
    "rerun": ["recorder", "datasets.rerun_rrd"],
    "rosbags": ["datasets.rosbag"],
    "sknetwork": ["mapping.communities"],
    "networkx": ["mapping.graph", "evaluation.bench_planner", "evaluation.bench_graphs"],
    "embreex": ["scenes"],
    "trimesh": ["scenes", "viewer", "exports.glb"],
    "numba": ["baselines", "checking", "datasets.lzf", "mapping", "navigation", "scenes"],
    "distributed": ["cluster.workers"],
    "onnxruntime": ["segmentation"],
    "community": ["evaluation.bench_graphs"],
    "openai": ["language.llm_http"],
    "httpx2": ["language.llm_http"],
    "PIL": ["checking.picture", "evaluation.picture", "viewer.share.film"],
    "lark": ["language"],
    "tyro": ["cli", "commands"],
    "rich": ["cli", "commands", "logs", "progress", "tables", "terminal"],
}


def modules() -> dict[str, Path]:
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        found[".".join(p for p in parts if p != "__init__")] = path
    return found


def line_of(module: str) -> tuple[int, str] | None:
    """The longest listed prefix wins, so that navigation.agent lies above the rest of navigation."""
    best = None
    for number, names in enumerate(LINES):
        for name in names:
            if (module == name or module.startswith(name + ".")) and (best is None or len(name) > len(best[1])):
                best = (number, name)
    return best


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            found.add(node.module or "")
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


ALL = {name: path for name, path in modules().items() if name}


@pytest.mark.parametrize("module", ALL)
def test_every_module_has_a_line_and_imports_only_from_below(module):
    mine = line_of(module)
    assert mine, f"{module}: not listed in LINES"
    for imported in imports(ALL[module]):
        if not imported.startswith("simaps_viz."):
            continue
        name = imported.removeprefix("simaps_viz.")
        while name not in ALL and "." in name:
            name = name.rpartition(".")[0]
        theirs = line_of(name)
        if theirs is None or (module, name) in UPWARDS:
            continue  # a name of the package itself, or an exception
        same_package = theirs == mine
        assert same_package or theirs[0] > mine[0], f"{module} imports {imported}, which is not below it"


def test_what_is_imported_upwards_is_not_loaded_with_the_module():
    for module, above in UPWARDS:
        mine, theirs = line_of(module), line_of(above)
        assert above in ALL and mine and theirs and theirs < mine
    bare = "import sys, types; sys.modules['simaps_viz'] = p = types.ModuleType('p'); p.__path__ = ['simaps_viz'];"
    for module, above in UPWARDS:
        code = f"{bare} import simaps_viz.{module}; print('simaps_viz.{above}' in sys.modules)"
        out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
        assert out.stdout.strip() == "False"


@pytest.mark.parametrize("module", ALL)
def test_libraries_stay_where_they_belong(module):
    for imported in imports(ALL[module]):
        top = imported.partition(".")[0]
        allowed = CONFINED.get(top)
        if allowed is not None:
            assert any(module == a or module.startswith(a + ".") for a in allowed), f"{module} imports {imported}"


@pytest.mark.parametrize("path", sorted([*PACKAGE.rglob("*.py"), *(ROOT / "apps").glob("*.py")]), ids=lambda p: p.name)
def test_files_stay_small(path):
    limit = 60 if path.parent.name == "apps" else 400
    assert len(path.read_text().splitlines()) <= limit


@pytest.mark.parametrize("path", sorted([*PACKAGE.rglob("*.py"), *(ROOT / "apps").glob("*.py")]), ids=lambda p: p.name)
def test_functions_stay_short(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno is not None:
            assert node.end_lineno - node.lineno < 60, f"{path}: {node.name}"


def test_nothing_evaluates_text():
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            called = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
            assert called not in ("eval", "exec", "compile", "__import__"), path


def test_importing_the_package_loads_neither_page_nor_recorder():
    heavy = "viser", "rerun", "onnxruntime", "trimesh", "embreex", "openai"
    code = f"import sys, simaps_viz; print([m for m in {heavy!r} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert out.stdout.strip() == "[]"
