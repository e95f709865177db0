"""How hypothesis runs here: the same examples every time, and no clock."""

from hypothesis import HealthCheck, settings


def examples(count):
    """Return settings for so many examples."""
    return settings(
        max_examples=count,
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
