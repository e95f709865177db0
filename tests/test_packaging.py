"""What a user installs is whole, works elsewhere, and imports no more than it needs."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

import serp

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = {
    "serp": ROOT / "serp",
    "serp_adapters": ROOT / "adapters" / "serp_adapters",
    "serp_envs": ROOT / "envs" / "serp_envs",
}


def run(command, cwd):
    """Run without anything in the environment that points Python at this checkout."""
    clean = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    return subprocess.run(
        command, cwd=cwd, env=clean, capture_output=True, text=True, timeout=600, check=False
    )


def output(command, cwd):
    """What a command prints that has to succeed."""
    done = run(command, cwd)
    assert done.returncode == 0, f"{command}:\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A folder with the source distribution and the wheel that is built from it.

    It is compiled without optimisation, which takes less time.
    """
    folder = tmp_path_factory.mktemp("dist")
    plain = "--config-setting=cmake.define.CMAKE_CXX_FLAGS_RELEASE=-O0"
    build = [sys.executable, "-m", "build", "--no-isolation", plain]
    output([*build, "--outdir", str(folder), str(ROOT)], folder)
    return folder


@pytest.fixture(scope="module")
def wheel(built):
    """The wheel."""
    (path,) = built.glob("serp-*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """The scripts' folder of an environment with the wheel, its dependencies borrowed from here.

    They come by a .pth file, which is not followed farther: an editable install of this checkout
    stays invisible. Pip has to install before it is there, or would find serp installed already.
    """
    folder = tmp_path_factory.mktemp("elsewhere") / "venv"
    venv.create(folder, with_pip=False)
    paths = {"base": str(folder), "platbase": str(folder)}
    scripts = Path(sysconfig.get_path("scripts", "venv", paths))
    pip = [sys.executable, "-m", "pip", "--python", str(scripts / "python")]
    output(
        [*pip, "install", "--quiet", "--no-deps", "--no-index", "--no-compile", str(wheel)], folder
    )
    here = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    site = Path(sysconfig.get_path("purelib", "venv", paths))
    (site / "borrowed.pth").write_text("\n".join(sorted(here)) + "\n")
    return scripts


# The wheel


def source_files():
    """Every module and template of the packages and every domain, by its name in the wheel."""
    names = {
        f"{package}/{path.relative_to(folder).as_posix()}"
        for package, folder in PACKAGES.items()
        for kind in ("*.py", "*.pyi", "templates/*", "*.css")
        for path in folder.rglob(kind)
    }
    domains = {f"serp_adapters/domains/{path.name}" for path in (ROOT / "domains").glob("*.*")}
    assert domains
    compiled = f"serp/_core{sysconfig.get_config_var('EXT_SUFFIX')}"
    return names | domains | {f"{package}/py.typed" for package in PACKAGES} | {compiled}


def test_the_wheel_holds_every_module_the_compiled_part_the_domains_and_the_type_markers(wheel):
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
        assert held == source_files()
        for path in (ROOT / "domains").glob("*.*"):
            assert archive.read(f"serp_adapters/domains/{path.name}") == path.read_bytes()


def test_the_source_distribution_holds_what_is_compiled(built):
    (source,) = built.glob("serp-*.tar.gz")
    with tarfile.open(source) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    native = [path for kind in ("*.cpp", "*.hpp") for path in PACKAGES["serp"].rglob(kind)]
    needed = {ROOT / "CMakeLists.txt", ROOT / ".ci" / "constraints.txt", *native}
    assert {path.relative_to(ROOT).as_posix() for path in needed} - held == set()


def test_the_citation_is_of_this_version():
    assert f"\nversion: {serp.__version__}\n" in (ROOT / "CITATION.cff").read_text()


# The compiled part


def test_a_checkout_that_is_not_built_says_how_to_build_it(tmp_path):
    shutil.copytree(
        PACKAGES["serp"], tmp_path / "serp", ignore=shutil.ignore_patterns("*.so", "*.pyd")
    )
    # -S: without the environment's own packages, so that no installed serp takes precedence.
    script = f"import sys; sys.path += {sys.path}; from serp.ui import main; main(['list'])"
    done = run([sys.executable, "-S", "-c", script], tmp_path)
    assert done.returncode == 1
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert "not built" in line
    assert "pip install -e ." in line


# The installation, used from another directory


def test_the_installed_command_works_without_the_checkout(installed, wheel, tmp_path):
    script = "import serp, serp_adapters, serp_envs as e; print(serp.__file__, e.__file__)"
    for path in output([str(installed / "python"), "-c", script], tmp_path).split():
        assert Path(path).is_relative_to(installed.parent)
    command = str(installed / "serp")
    assert wheel.name.split("-")[1] in output([command, "--version"], tmp_path).split()
    assert "cartpole: well formed" in output([command, "check", "cartpole"], tmp_path)


# Optional parts

OPTIONAL = (
    "Box2D", "PIL", "distributed", "imageio_ffmpeg", "matplotlib", "minigrid", "optuna", "pygame",
    "pymunk", "ray", "stable_baselines3", "unified_planning",
)  # fmt: skip
WITHOUT = f"""
import shlex, sys
sys.modules.update(dict.fromkeys({OPTIONAL}))  # importing them fails
from serp.ui import main
for line in sys.argv[1:]:
    try:
        main(shlex.split(line))
    except SystemExit as end:
        print("status", end.code, flush=True)
"""


def test_planning_and_learning_need_no_extra_and_what_needs_one_says_which(tmp_path):
    """In one process where nothing is installed that only an extra brings."""
    free = (
        "list",
        "check cartpole",
        "plan --domain cartpole --svg plan.svg",
        "plan-and-learn --domain cartpole --env-steps 60 --out run --quiet",
        "evaluate run --episodes 1",
        "diagnose run",
        "repair run",
    )
    needs = {
        "plots": "diagnose run --svg diagnosis.svg",
        "minigrid": "plan --domain four-rooms --observe",
        "box2d": "plan --domain lunar-lander",
        "tune": "tune --domain cartpole --vary planner.depth=2..3 --env-steps 30",
        "report": "compare --domain cartpole --algorithms mrp --env-steps 30",
        "soccer": "plan-and-learn --domain soccer --env-steps 30",
    }
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, *free, *needs.values(), "check soccer"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300,
        check=False,
    )  # fmt: skip
    shown = done.stdout
    assert "Traceback" not in shown, shown
    parts = re.split(r"^status (\d)\n", shown, flags=re.M)
    assert parts[1::2] == ["0"] * len(free) + ["1"] * (len(needs) + 1), shown
    for extra, said in zip([*needs, "soccer"], parts[2 * len(free) :: 2], strict=False):
        assert f"pip install 'serp[{extra}]'" in said
    assert "soccer: not checked" in shown
    assert [file.parent.name for file in tmp_path.glob("**/metrics.csv")] == ["run"]
