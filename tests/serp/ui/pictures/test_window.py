"""The window shows the film in its time, and where there is no screen, says what to do."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

import pytest
from PIL import Image

from serp.ui.pictures.caption import Caption
from serp.ui.pictures.film import Frame
from serp.ui.pictures.window import NoDisplay, Window

pygame = pytest.importorskip("pygame")


@pytest.fixture
def dummy(monkeypatch: pytest.MonkeyPatch) -> None:
    """A screen that shows nothing, taken for one."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(pygame.display, "get_driver", lambda: "x11")


def frames(count: int, seconds: float = 0.01) -> list[Frame]:
    return [
        Frame(Image.new("RGB", (64, 48), (number, 0, 200)), seconds, Caption(None, "", ()), None)
        for number in range(count)
    ]


def test_every_frame_is_shown_for_its_time(dummy: None) -> None:
    seen = []

    def looked_at() -> Iterator[Frame]:
        for frame in frames(10, 0.02):
            yield frame
            seen.append(pygame.display.get_surface().get_at((5, 5))[:3])

    with Window("watching") as shown:
        begun = time.monotonic()
        assert shown.show(looked_at())
        assert time.monotonic() - begun >= 10 * 0.02
        assert pygame.display.get_caption()[0] == "watching"
    assert seen == [(number, 0, 200) for number in range(10)]
    assert not pygame.display.get_init()


@pytest.mark.parametrize("key", ["escape", "q", "cross"])
def test_closing_the_window_ends_it(dummy: None, key: str) -> None:
    taken = []

    def closing() -> Iterator[Frame]:
        for number, frame in enumerate(frames(1000)):
            taken.append(number)
            if number == 3 and key == "cross":
                pygame.event.post(pygame.event.Event(pygame.QUIT))
            elif number == 3:
                press = pygame.event.Event(pygame.KEYDOWN, key=pygame.key.key_code(key))
                pygame.event.post(press)
            yield frame

    with Window("watching") as shown:
        assert not shown.show(closing())
    assert len(taken) == 4


def test_space_pauses_until_it_is_pressed_again(dummy: None) -> None:
    space = pygame.event.Event(pygame.KEYDOWN, key=pygame.K_SPACE)
    with Window("watching") as shown:
        assert shown.show(frames(1))
        pygame.event.post(space)
        pygame.time.set_timer(space, 200, 1)
        begun = time.monotonic()
        assert shown.show(frames(2))
        assert time.monotonic() - begun >= 0.2


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="these need no DISPLAY")
@pytest.mark.parametrize(
    "environment", [{}, {"SDL_VIDEODRIVER": "dummy"}, {"SDL_VIDEODRIVER": "x11", "DISPLAY": ":987"}]
)
def test_without_a_screen_the_message_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, environment: dict[str, str]
) -> None:
    pygame.display.quit()
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(NoDisplay, match="no window can be opened here .*--out FILE.gif"):
        Window("watching")
