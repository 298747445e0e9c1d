"""Observations of several targets as of one."""

import numpy as np
from support.made_ground import WATERS, make_ground

from sucre_bench.multiview.observations import pooled
from sucre_bench.multiview.observe import observe


def test_pooled_observations_keep_what_every_view_shows_of_every_pixel() -> None:
    scene = make_ground(WATERS["green"], width=48, height=36, heights_m=(1.5, 2.0, 2.7))
    parts = [
        observe(view, scene.views, with_view=True, with_ray=True) for view in scene.views[1:]
    ]
    whole = pooled(parts, [view.name for view in scene.views])
    assert (np.diff(whole.counts) <= 0).all()
    assert len(whole) == sum(map(len, parts))
    for k, one in enumerate(parts):
        mine = whole.take(np.flatnonzero(whole.pixels // (48 * 36) == k))
        np.testing.assert_array_equal(mine.pixels - k * 48 * 36, one.pixels)
        for name in ("counts", "starts", "distance", "ray"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(one, name))
        np.testing.assert_allclose(mine.colour, one.intensity(slice(None)))
        names = [[seen.views[v] for v in seen.view] for seen in (mine, one)]
        assert names[0] == names[1]
