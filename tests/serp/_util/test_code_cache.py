"""The folder of compiled code: healed where it is damaged, left alone where others can write."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from serp._util.compilation import cache_folder
from serp.errors import Notice
from serp.model.codegen import generate_code
from serp.model.native import compile_native
from tests.generated import Texts, load_texts

HEATER = Texts(
    "(define (domain d) (:functions (heat)) (:action warm :effect (increase (heat) 0.5)))", None
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "new"
    monkeypatch.setenv("SERP_CACHE_DIR", str(path))
    return path


def test_the_folder_is_made_for_its_owner_alone(folder: Path) -> None:
    compile_native(generate_code(load_texts(HEATER).model.ground))
    assert cache_folder() == folder
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert [stat.S_IMODE(file.stat().st_mode) for file in folder.iterdir()] == [0o600]


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"not what it was",
        lambda content: content[:10],
        lambda content: content[:-1],
        lambda content: content[:1000] + bytes([content[1000] ^ 1]) + content[1001:],
    ],
)
def test_damaged_code_is_removed_compiled_anew_and_spoken_of(
    folder: Path, damage: Callable[[bytes], bytes]
) -> None:
    ground = load_texts(HEATER).model.ground
    compile_native(generate_code(ground))
    (file,) = folder.iterdir()
    file.write_bytes(damage(file.read_bytes()))
    with pytest.warns(Notice, match="was damaged; it is compiled again"):
        assert compile_native(generate_code(ground)).cache_hits == 0
    assert list(folder.iterdir()) == [file]
    assert compile_native(generate_code(ground)).cache_hits == 1


def open_to_all(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o777)


def open_to_a_group(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o775)


def of_another_user(folder: Path) -> None:
    if os.getuid() != 0:
        pytest.skip("only root may give a folder away")
    folder.mkdir(mode=0o755)
    os.chown(folder, 12_345, 12_345)


@pytest.mark.skipif(sys.platform == "win32", reason="folders have no such modes there")
@pytest.mark.parametrize(
    ("make", "said"),
    [
        (open_to_all, "others can write: chmod go-w"),
        (open_to_a_group, "others can write: chmod go-w"),
        (of_another_user, "belongs to another user"),
        (Path.touch, "cannot be kept"),
    ],
)
def test_a_folder_that_is_not_the_users_own_is_not_used(
    folder: Path, make: Callable[[Path], None], said: str
) -> None:
    make(folder)
    ground = load_texts(HEATER).model.ground
    with pytest.warns(Notice, match=said):
        compile_native(generate_code(ground))
    assert compile_native(generate_code(ground)).cache_hits == 0
    assert folder.is_file() or not list(folder.iterdir())
