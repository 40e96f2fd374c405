"""The project itself: its layout, its imports, its READMEs."""

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions, version

import pytest
import yaml

import fivcore
from studies import registry
from studies.answering import claims
from studies.asking.sweep import sweep_of
from tests import HOME, make_reference
from tests.docs import readmes

README = readmes.TEXTS["README.md"]


@cache
def imports(package: str) -> dict[str, list[tuple[str, tuple[str, ...]]]]:
    """The imports of each module of a package, as modules and the names taken from them.

    Imports within functions, for types only, and `import_module` of a literal are among them.
    """
    found: dict[str, list[tuple[str, tuple[str, ...]]]] = {}
    for file in (HOME / package).rglob("*.py"):
        nodes = list(ast.walk(ast.parse(file.read_text())))
        whole = [(alias.name, ()) for node in nodes if isinstance(node, ast.Import) for alias in node.names]
        parts = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.module]
        calls = [node for node in nodes if isinstance(node, ast.Call) and node.args]
        called = [each.args[0] for each in calls if ast.unparse(each.func).endswith("import_module")]
        whole += [(str(each.value), ()) for each in called if isinstance(each, ast.Constant)]
        name = ".".join(file.relative_to(HOME).with_suffix("").parts).removesuffix(".__init__")
        found[name] = whole + [(node.module, tuple(alias.name for alias in node.names)) for node in parts]
    return found


def imported(package: str) -> set[str]:
    """Top-level names of everything that a package imports."""
    return {module.partition(".")[0] for each in imports(package).values() for module, _ in each}


def test_imports_point_one_way():
    files = {"dask", "distributed", "xarray", "netCDF4", "matplotlib"}
    assert not imported("fivcore") & {"studies", "sweeps", *files}
    assert not imported("sweeps") & {"studies", "fivcore", "numba", "matplotlib", "click"}
    assert {"fivcore", "sweeps"} <= imported("studies")
    # Only the fronts of engine and core are used.
    outside = [pair for each in imports("studies").values() for pair in each]
    assert not [module for module, _ in outside if module.startswith(("sweeps.", "fivcore."))]
    public = {*fivcore.__all__}
    assert {name for module, names in outside if module == "fivcore" for name in names} <= public
    assert all(hasattr(fivcore, name) for name in public)


def test_the_engine_imports_no_private_names():
    """Neither of its own modules nor of libraries, within which they may change."""
    taken = {
        f"{name}: {module} {one}"
        for name, each in imports("sweeps").items()
        for module, names in each
        for one in (*module.split("."), *names)
        if re.match(r"_(?!_)", one)
    }
    assert taken == set()


def module_imports(package: str) -> dict[str, set[str]]:
    """The modules of a package that each of its modules imports."""
    modules, graph = imports(package), {}
    for name, each in modules.items():
        graph[name] = set()
        for module, names in each:
            # `from package import module` is an import of the module.
            inner = {f"{module}.{one}" for one in names}
            graph[name] |= ({module} if not names or inner - set(modules) else set()) | inner
        graph[name] &= set(modules)
    return graph


def in_circles(graph: dict[str, set[str]]) -> set[str]:
    """Nodes of a graph from which a path leads back to them."""

    def reached(start: str) -> set[str]:
        found: set[str] = set()
        waiting = list(graph[start])
        while waiting:
            name = waiting.pop()
            if name not in found:
                found.add(name)
                waiting += graph[name]
        return found

    return {name for name in graph if name in reached(name)}


def child_imports(package: str) -> dict[str, set[str]]:
    """The modules and sub-packages directly in a package that each of them imports, with all that it contains."""

    def child(module: str) -> str:
        return ".".join(module.split(".")[: package.count(".") + 2])

    graph: dict[str, set[str]] = {}
    for name, modules in module_imports(package.partition(".")[0]).items():
        if f"{name}.".startswith(f"{package}."):
            inside = {child(each) for each in modules if f"{each}.".startswith(f"{package}.")}
            graph.setdefault(child(name), set()).update(inside - {child(name)})
    return graph


@pytest.mark.parametrize("package", ["fivcore", "sweeps", "studies"])
def test_imports_form_no_circle(package):
    """Neither modules, nor, within any package, its modules and sub-packages."""
    found = {f"modules of {package}": in_circles(module_imports(package))}
    for file in (HOME / package).rglob("__init__.py"):
        name = ".".join(file.parent.relative_to(HOME).parts)
        found[name] = in_circles(child_imports(name))
    assert {name: circle for name, circle in found.items() if circle} == {}


# Rooms of studies and files of its root, the lowest floor first.
FLOORS = (
    "paper", "declaring", "motion", "physics", "study", "answering", "asking", "plotting", "gallery", "accuracy",
    "stress", "registry", "fitting", "runner", "query", "report", "cli", "__main__",
)  # fmt: skip


def test_studies_import_from_the_floors_below_only():
    graph = {name.removeprefix("studies."): below for name, below in child_imports("studies").items()}
    graph.pop("studies")  # the names for users
    assert sorted(graph) == sorted(FLOORS)
    for name, below in graph.items():
        names = {each.removeprefix("studies.") for each in below} - {"studies"}
        assert names <= {*FLOORS[: FLOORS.index(name)]}, name


def test_no_study_of_the_gallery_imports_another():
    """What studies share is physics, or how it is drawn."""
    graph = module_imports("studies")
    pairs = {(n, each) for n in graph for each in graph[n] if n.startswith("studies.gallery.")}
    assert {pair for pair in pairs if pair[1].startswith("studies.gallery.")} == set()


# Names of studies that are words of something else there: an argument, a dimension, a variable, Matplotlib's.
ORDINARY = {"scenes", "contact", "damping", "patch", "stick_time"}


def texts_of(file):
    """The string literals of a module but its docstrings, with the parts of f-strings."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    parents = [node for node in ast.walk(tree) if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef))]
    docs = {id(node.body[0].value) for node in parents if isinstance(node.body[0], ast.Expr)}
    texts = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return [node.value for node in texts if id(node) not in docs]


def test_central_code_names_no_study():
    """It finds studies by their roles; names stand in the registry alone, and in the studies themselves."""
    own = ("gallery", "accuracy", "stress", "registry.py")
    files = [file for file in (HOME / "studies").rglob("*.py") if file.relative_to(HOME).parts[1] not in own]
    # In messages, where most names are words of the language, those with a number count.
    numbered = {name for name in registry.NAMES if re.search(r"\d", name)}
    found = {
        f"{file.relative_to(HOME)}: {text}"
        for file in files
        for text in texts_of(file)
        if text in {*registry.NAMES} - ORDINARY or numbered & {*re.findall(r"\w+", text)}
    }
    assert found == set()


def test_roles_of_studies_are_those_in_the_catalogue():
    listed = {role for name in registry.NAMES for role in registry.load(name).roles}
    assert listed == {"first", "modes", "motions", "states", "measured"}
    for role in listed:
        found = registry.names_for(role)
        assert found == [name for name in registry.NAMES if role in registry.load(name).roles]


def test_the_root_of_studies_is_a_hall():
    assert len([*(HOME / "studies").glob("*.py")]) <= 6


def test_no_test_imports_another():
    """What tests share stands in conftest files and in tests/helpers."""
    tests = {name for name in module_imports("tests") if name.rpartition(".")[2].startswith("test_")}
    found = {name: sorted(names & tests) for name, names in module_imports("tests").items() if names & tests}
    assert not found


def test_studies_are_loaded_without_matplotlib():
    code = "import sys; from studies import registry; [registry.load(name) for name in registry.NAMES]; "
    code += "print('matplotlib' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=HOME, check=True)
    assert done.stdout == "False\n"


def test_the_core_needs_nothing_within_numba():
    files = [file.read_text() for file in (HOME / "fivcore").rglob("*.py")]
    assert not imported("fivcore") & {"llvmlite", "ctypes"}
    within = r"numba\.(core|types|np)\b|numba\.extending\b(?! import register_jitable$)"
    assert not any(re.search(within, text, re.MULTILINE) for text in files)


def test_wrong_input_is_an_error_of_its_own():
    """A plain ValueError is a fault, except in what a user's function returns, and of a damaged file."""
    folders = [HOME / package for package in ("fivcore", "sweeps", "studies")]
    plain = {
        file
        for folder in folders
        for file in folder.rglob("*.py")
        if re.search(r"\bValueError\(", file.read_text())
    }
    assert {file.name for file in plain} == {"parts.py", "task.py"}


def test_the_top_level_is_as_agreed():
    if not (HOME / ".git").exists():
        pytest.skip("git alone knows which files belong to the project")
    listed = subprocess.run(["git", "ls-files"], capture_output=True, text=True, cwd=HOME, check=True).stdout
    tracked = {line.partition("/")[0] for line in listed.splitlines()}
    shown = {name for name in tracked if not name.startswith(".")}
    assert shown == {"README.md", "pyproject.toml", "fivcore", "results", "studies", "sweeps", "tests"}


def test_every_dependency_has_its_reason():
    """As a comment on its line."""
    text = (HOME / "pyproject.toml").read_text()
    needed = text.partition("\ndependencies = [\n")[2].partition("\n]")[0].splitlines()
    assert len(needed) > 10
    assert [line for line in needed if not re.fullmatch(r' +"[^"]+", +# .{5,}', line)] == []


def test_every_import_is_declared():
    """What is there only because another library needs it may go with that library's next version."""
    project = tomllib.loads((HOME / "pyproject.toml").read_text())["project"]
    needed = [*project["dependencies"], *project["optional-dependencies"]["uff"]]
    # Of "dask[distributed]>=2026.8" both names.
    declared = {name.lower() for each in needed for name in re.findall(r"[\w-]+", re.split("[<>=]", each)[0])}
    provided, own = packages_distributions(), {"fivcore", "sweeps", "studies"}
    for package in own:
        others = imported(package) - sys.stdlib_module_names - own
        missing = {name for name in others if not {each.lower() for each in provided[name]} & declared}
        assert missing == set(), package


def test_the_numba_in_use_is_the_newest_that_is_allowed():
    """Kernels are tested with one series of Numba; another may compile them otherwise, or not at all."""
    project = tomllib.loads((HOME / "pyproject.toml").read_text())["project"]
    (requirement,) = (each for each in project["dependencies"] if each.startswith("numba"))
    low, high = re.fullmatch(r"numba>=0\.(\d+),<0\.(\d+)", requirement).groups()
    series = int(version("numba").split(".")[1])
    assert int(low) <= series == int(high) - 1


def test_ci_runs_the_readmes_test_command_and_kernels_on_a_generic_processor():
    block = README.partition("<!-- test command -->\n```sh\n")[2].partition("\n```")[0]
    assert block.count("\n") == 0
    assert "pytest" in block
    script = (HOME / ".ci" / "run").read_text()
    assert "'/<!-- test command -->/,/^```$/p' README.md" in script
    lines = [line for line in script.splitlines() if "pytest" in line]
    folders = "tests/fivcore tests/verification tests/gallery"
    assert lines == [f'NUMBA_CPU_NAME=generic NUMBA_CPU_FEATURES="" .venv/bin/python -m pytest {folders}']


def test_the_public_ci_takes_the_same_steps_on_three_systems():
    workflow = yaml.safe_load((HOME / ".github" / "workflows" / "ci.yml").read_text())
    lint, tests = ([s["run"] for s in workflow["jobs"][n]["steps"] if "run" in s] for n in ("lint", "tests"))
    script = (HOME / ".ci" / "run").read_text()
    tools = [
        line.replace('"', "").split("/bin/")[1] for line in script.splitlines() if line.startswith('"$tools/bin/')
    ]
    assert lint == ['python -m pip install -e ".[lint]"', *tools[1:]]
    assert {system.split("-")[0] for system in workflow["jobs"]["tests"]["strategy"]["matrix"]["os"]} == {
        "ubuntu", "macos", "windows",
    }  # fmt: skip
    (command,) = (text.strip() for text in readmes.blocks("sh", "README.md") if "--clear" in text)
    *steps, kernels = (step.replace("${{ matrix.bin }}", ".venv/bin") for step in tests)
    assert " && ".join(steps) == command.replace("python3", "python")
    assert kernels in script


def test_commits_are_checked_by_the_tools_of_lint_alone():
    (hooks,) = yaml.safe_load((HOME / ".pre-commit-config.yaml").read_text())["repos"]
    assert hooks["repo"] == "local"
    entries = [hook["entry"].replace(" --force-exclude", "") for hook in hooks["hooks"]]
    assert entries == ["ruff check", "ruff format", "mypy"]


def test_packages_say_that_they_are_typed():
    patterns = tomllib.loads((HOME / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    assert "py.typed" in patterns["*"]
    assert all((HOME / package / "py.typed").is_file() for package in ("fivcore", "sweeps", "studies"))


def anchors(text: str) -> set[str]:
    """Names of a text's headings in links, as GitHub makes them."""
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    heads = re.findall(r"^#+ (.*)$", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("name", readmes.NAMES)
def test_links_lead_somewhere(name):
    links = re.findall(r"\]\(([^)]*)\)", readmes.TEXTS[name])
    assert links
    for link in links:
        path, _, anchor = link.partition("#")
        target = (HOME / name).parent / path if path else HOME / name
        assert target.is_file(), link
        assert not anchor or anchor in anchors(target.read_text()), link


def test_the_first_readme_leads_to_all_others():
    assert set(readmes.NAMES[1:]) <= set(re.findall(r"\]\(([^)#]*)[^)]*\)", README))


@pytest.mark.parametrize("name", readmes.NAMES)
def test_files_and_modules_that_are_named_exist(name):
    words = re.findall(r"`([^`\s]+)`", readmes.TEXTS[name])
    paths = [word for word in words if re.match(r"(fivcore|sweeps|studies|tests|results/reference)/", word)]
    assert [path for path in paths if not (HOME / path).exists()] == []
    modules = re.findall(r"python -m ((?:tests|studies)[\w.]*)", " ".join(readmes.TEXTS[name].split()))
    places = [HOME.joinpath(*module.split(".")) for module in modules]
    assert [place for place in places if not (place.is_dir() or place.with_suffix(".py").is_file())] == []


def test_every_study_has_its_row():
    table = readmes.TEXTS["studies/README.md"].partition("| study | what it shows |")[2].partition("\n\n")[0]
    assert sorted(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == sorted(registry.NAMES)


REFERENCE = HOME / "results" / "reference"
KEPT = [(name, REFERENCE, {}) for name in registry.NAMES]
KEPT += [(name, REFERENCE / make_reference.IDENTIFIED, claims.IDENTIFIED | make_reference.TWICE[name])
         for name in make_reference.TWICE]  # fmt: skip


@pytest.mark.parametrize(("name", "folder", "values"), KEPT)
def test_the_results_kept_here_are_those_of_this_code(name, folder, values):
    plan = sweep_of(registry.load(name), values).plan(folder / name / f"{name}.nc")
    assert (plan.todo, plan.failed, plan.whole) == (0, 0, True)
