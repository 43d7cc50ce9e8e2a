"""A map of 200 m x 200 m on a real page: it is seen whole, and its objects can be clicked."""

from benchmarks.large_maps import large_map
from browser import free_port, mine, on_canvas, open_workbench, until, wait_for_color, watched_page

from simaps_viz.app import workbench
from simaps_viz.colors.instances import instance_colors


def test_a_map_of_sixteen_million_cells_is_seen_to_its_corners_and_clicked(browser):
    simap = large_map(4000, 4000, 64, edges=False)
    colors = instance_colors(simap)
    far = max(simap.instances, key=lambda one: one.centroid_m[0] + one.centroid_m[1])
    assert min(far.centroid_m[:2]) > 150.0
    served = workbench.open_workbench(simap, recording=None, port=free_port())
    with served as bench, watched_page(browser) as page:
        open_workbench(page, bench)
        for one in (simap.instances[0], far):
            place = one.centroid_m[0] + 1.0, one.centroid_m[1] + 1.0  # the middle is where two halves meet
            wait_for_color(bench, page, place, colors[one.id])
            page.mouse.click(*on_canvas(bench, page, *place))
            until(page, lambda one=one: mine(bench).selected == one.id)
