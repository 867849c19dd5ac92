"""The history behind every chart."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from web.history import History


@given(st.lists(st.floats(0.001, 0.9), min_size=1, max_size=60))
def test_it_keeps_the_newest_values_in_order(steps: list[float]) -> None:
    history = History(1, window_s=1.0, period_s=0.1)
    kept = np.array([now for now in np.cumsum(steps) if history.append(float(now), np.array([now]))])[-10:]
    np.testing.assert_allclose(history.values[-len(kept) :, 0], kept)
    np.testing.assert_allclose(history.age_s[-len(kept) :], kept - kept[-1])
    assert history.largest() == kept[-1]
    assert (np.diff(kept) >= 0.1 - 1e-9).all()


def test_a_clock_that_is_set_back_takes_away_what_was_later() -> None:
    history = History(1, window_s=1.0, period_s=0.1)
    for now in (5.0, 5.2, 5.4, 5.6):
        history.append(now, np.array([now]))
    history.append(5.31, np.array([-1.0]))
    np.testing.assert_allclose(history.values[-3:, 0], [5.0, 5.2, -1.0])
    history.append(0.0, np.array([0.0]))
    assert np.isnan(history.values[:-1]).all()
