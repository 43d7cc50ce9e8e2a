"""A ride that meets a fault of the program: it is told on the page, the robot stands, and the next command drives."""

import threading

import pytest
from browser import toy_services, toy_workbench
from fake_page import fake_page
from waiting import until

from simaps_viz.navigation.trajectory import TrajectoryPlayer, trajectory
from simaps_viz.viewer.panels.command import CommandPanel


def test_what_a_listener_raises_ends_the_ride_and_is_told():
    told: list[Exception] = []
    fault = ZeroDivisionError("a fault")

    def moved(pose, share, leg):
        raise fault

    drive = TrajectoryPlayer(moved, lambda: None, on_error=told.append)
    drive.start(trajectory([[0, 0, 0], [2.0, 0, 0]]))
    until(lambda: told == [fault])
    assert not drive.active


def test_a_ride_that_was_stopped_tells_no_fault():
    told: list[Exception] = []
    moving = threading.Event()

    def moved(pose, share, leg):
        drive.stop()
        moving.set()
        raise ZeroDivisionError("too late")

    drive = TrajectoryPlayer(moved, lambda: None, on_error=told.append)
    before = set(threading.enumerate())
    drive.start(trajectory([[0, 0, 0], [2.0, 0, 0]]))
    assert moving.wait(60.0)
    until(lambda: set(threading.enumerate()) <= before)
    assert told == [] and not drive.active


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_nobody_told_is_no_silence(capsys):
    raised = []
    hook, threading.excepthook = threading.excepthook, lambda told: raised.append(told.exc_value)
    try:
        drive = TrajectoryPlayer(lambda pose, share, leg: print(1 / 0), lambda: None)
        drive.start(trajectory([[0, 0, 0], [2.0, 0, 0]]))
        until(lambda: raised)
    finally:
        threading.excepthook = hook
    assert isinstance(raised[0], ZeroDivisionError) and not drive.active


def test_the_page_says_it_and_the_robot_drives_again(caplog):
    with toy_workbench(toy_services()) as bench, fake_page(bench) as page:
        robot = page.session.panels[CommandPanel]
        show, shown = robot._scene.show_robot, []

        def fails_once(pose):
            if robot.driving and not shown:
                shown.append(pose)
                raise RuntimeError("the scene is gone")
            show(pose)

        robot._scene.show_robot = fails_once  # type: ignore[method-assign]
        robot.ask("go to the chair")
        until(lambda: "unexpected error" in robot._result.content)
        until(lambda: page.session.wait_idle(60.0) and robot._phase == "idle")
        assert not robot.driving and not robot._progress.visible
        assert "the workbench met an error" in caplog.text
        robot._drive.speed = 8.0
        robot.ask("go to the chair")
        until(lambda: "Done" in robot._result.content)
        assert page.session.pose.x_m == 1.5
