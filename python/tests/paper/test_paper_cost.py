"""Operations and run time of the paper's comparison."""

from paper_toys import HEIGHT, WIDTH, toy

from liveview_ref.paper.measure import cost, cost_worker
from liveview_ref.paper.methods.liveview import liveview
from liveview_ref.paper.methods.registry import Entry


def test_multiply_adds_of_the_network_are_those_of_the_paper(net):
    shot = toy()
    counted = cost_worker.multiply_adds(net, shot.photos, shot.camera, shot.planes(8))
    convolutions = 8 * 28_800 * WIDTH * HEIGHT  # unet.py: per pixel and layer at V = 4
    assert 0 <= counted - convolutions < 1000  # plus the cameras' 3 x 3 products


def test_time_of_inner_stages_is_not_counted_twice():
    stages = cost_worker.Stages()
    now = iter([0.0, 1.0, 3.0, 7.0, 15.0, 31.0])
    clock, cost_worker.time.perf_counter = cost_worker.time.perf_counter, lambda: next(now)
    try:
        stages.start()
        stages.enter("network")
        stages.enter("warp")
        stages.leave()
        stages.leave()
        stages.switch()
    finally:
        cost_worker.time.perf_counter = clock
    assert stages.seconds == {"warp": 4.0, "network": 2.0 + 8.0, "render": 1.0 + 16.0}


def test_cost_rows_have_each_method_once_and_liveview_on_fewer_planes():
    entries = [Entry("liveview", 4, liveview), Entry("liveview", 5, liveview), Entry("fusion", 10, liveview)]
    rows = [(row.name, row.planes) for row in cost.rows_of(entries)]
    assert rows == [("liveview_v5", 64), ("liveview_v5", 32), ("liveview_v5", 16), ("fusion_v10", 64)]
