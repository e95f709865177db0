"""The window shows the film in its time, and where there is no screen, says what to do."""

from __future__ import annotations

import sys
import time

import pytest
from PIL import Image

from serp.errors import MissingExtra
from serp.viz.caption import Caption
from serp.viz.film import Frame
from serp.viz.window import NoDisplay, Window, require_display

pygame = pytest.importorskip("pygame")


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def dummy(no_screen: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


def frames(count: int, seconds: float = 0.01) -> list[Frame]:
    return [
        Frame(Image.new("RGB", (64, 48), (number, 0, 200)), seconds, Caption(None, "", ()), None)
        for number in range(count)
    ]


def press(key: int) -> None:
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))


def test_every_frame_is_shown_for_its_time(dummy: None) -> None:
    seen = []

    def looked_at() -> object:
        for frame in frames(10, 0.02):
            yield frame
            seen.append(pygame.display.get_surface().get_at((5, 5))[:3])

    with Window("watching") as window:
        begun = time.monotonic()
        assert window.show(looked_at())  # type: ignore[arg-type]
        assert time.monotonic() - begun >= 10 * 0.02
        assert pygame.display.get_caption()[0] == "watching"
    assert seen == [(number, 0, 200) for number in range(10)]
    assert not pygame.display.get_init()


@pytest.mark.parametrize("key", ["escape", "q", "cross"])
def test_closing_the_window_ends_it(dummy: None, key: str) -> None:
    taken = []

    def closing() -> object:
        for number, frame in enumerate(frames(1000)):
            taken.append(number)
            if number == 3:
                if key == "cross":
                    pygame.event.post(pygame.event.Event(pygame.QUIT))
                else:
                    press(pygame.key.key_code(key))
            yield frame

    with Window("watching") as window:
        assert not window.show(closing())  # type: ignore[arg-type]
    assert len(taken) == 4


def test_space_pauses_until_it_is_pressed_again(dummy: None) -> None:
    with Window("watching") as window:
        assert window.show(frames(1))
        press(pygame.K_SPACE)
        pygame.time.set_timer(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_SPACE), 200, 1)
        begun = time.monotonic()
        assert window.show(frames(2))
        assert time.monotonic() - begun >= 0.2


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="these need no DISPLAY")
def test_without_a_screen_the_message_says_what_to_do(no_screen: None) -> None:
    with pytest.raises(NoDisplay, match="DISPLAY.*--out FILE.gif"):
        require_display()


def test_a_driver_that_shows_nothing_is_no_screen(dummy: None) -> None:
    with pytest.raises(NoDisplay, match="SDL_VIDEODRIVER is dummy.*--out FILE.gif"):
        require_display()


def test_a_screen_that_is_not_there_after_all(
    no_screen: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    pygame.display.quit()
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")
    monkeypatch.setenv("DISPLAY", ":987")
    require_display()
    with pytest.raises(NoDisplay, match="--out FILE.gif"):
        Window("watching")


def test_without_pygame_the_extra_is_named(
    no_screen: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(MissingExtra, match="pip install 'serp\\[watch\\]'") as caught:
        require_display()
    assert "--out FILE.gif" in caught.value.__notes__[0]
