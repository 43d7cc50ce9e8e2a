"""Puts the panels of one page where they belong."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import viser

from simaps_viz.structures import Instance, SIMap
from simaps_viz.viewer.page.panel import BUILT_IN, INSTANCE, JUDGE, Desk, Panel, PanelSpec
from simaps_viz.viewer.panels.build import BuildPanel
from simaps_viz.viewer.panels.find import FindBox
from simaps_viz.viewer.panels.help import OTHER_TABS, HelpPanel, PageActions
from simaps_viz.viewer.panels.instance import InstancePanel
from simaps_viz.viewer.panels.judge import JudgePanel
from simaps_viz.viewer.panels.map import MapActions, MapPanel
from simaps_viz.viewer.panels.robot import RobotControl
from simaps_viz.viewer.panels.steps import StepsPanel
from simaps_viz.viewer.panels.why import WhyActions, WhyPanel
from simaps_viz.viewer.recording.link import words_beside
from simaps_viz.viewer.scene.camera import SLANT, Follower, with_margin

if TYPE_CHECKING:
    from simaps_viz.viewer.session import Session


@dataclass(frozen=True, eq=False)
class _Made:
    spec: PanelSpec
    panel: Panel
    tab: Any


class ExtraPanels:
    """Made from specs, told what happens on the page, and exchanged when the page's map is done."""

    def __init__(self, desk: Desk, specs: Sequence[PanelSpec]) -> None:
        """Take the page and what it shall have; ``place`` makes them."""
        self._desk = desk
        self._groups: dict[str, Any] = {}
        self.specs = specs
        """What the panels were made of."""
        self._made: list[_Made] = []

    def __iter__(self) -> Iterator[tuple[str, Panel]]:
        return iter([(one.spec.title, one.panel) for one in self._made])

    def place(self, place: str, group: Any) -> None:
        """Make the panels that belong in a group of tabs."""
        self._groups[place] = group
        self._add([spec for spec in self.specs if spec.place == place])

    def renew(self, specs: Sequence[PanelSpec]) -> None:
        """Have these instead; those that were there already stay as they are."""
        self.specs = specs
        for one in [one for one in self._made if one.spec not in specs]:
            self._made.remove(one)
            self._guarded(one.panel.close)
            one.tab.remove()
        there = [one.spec for one in self._made]
        self._add([spec for spec in specs if spec not in there])

    def map_changed(self, simap: SIMap) -> None:
        """Another map is shown."""
        for _, panel in self:
            self._guarded(lambda panel=panel: panel.map_changed(simap))

    def selection_changed(self, instance_id: int | None) -> None:
        """Another object is selected, or none."""
        for _, panel in self:
            self._guarded(lambda panel=panel: panel.selection_changed(instance_id))

    def show_frame(self, frame: int) -> None:
        """Another frame is shown."""
        for _, panel in self:
            self._guarded(lambda panel=panel: panel.show_frame(frame))

    def theme_changed(self) -> None:
        """The page went from light to dark, or back."""
        for _, panel in self:
            self._guarded(panel.theme_changed)

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Offer a click on the map to the panels that may wait for one."""
        return any(panel.take_click(x_m, y_m) for _, panel in self)

    def states(self) -> dict[str, Any]:
        """Return what was done on each panel."""
        found: dict[str, Any] = {}
        for title, panel in self:
            self._guarded(lambda title=title, panel=panel: found.update({title: panel.state()}))
        return found

    def restore(self, states: Mapping[str, Any]) -> None:
        """Hand the panels what ``states`` gave."""
        for title, panel in self:
            if states.get(title) is not None:
                self._guarded(lambda title=title, panel=panel: panel.restore(states[title]))

    def close(self) -> None:
        """The person has gone."""
        for _, panel in self:
            self._guarded(panel.close)

    def _add(self, specs: Sequence[PanelSpec]) -> None:
        """Make panels in tabs of their own; one that fails is missing, and its error is told."""
        for spec in specs:
            tab = self._groups[spec.place].add_tab(spec.title, spec.icon)
            try:
                with tab:
                    self._made.append(_Made(spec, spec.make(self._desk), tab))
            except Exception as error:
                self._desk.report(error)

    def _guarded(self, do: Callable[[], object]) -> None:
        try:
            do()
        except Exception as error:
            self._desk.report(error)


RECORDING_WIDTH_PX = 400
ROOMY_PX, NARROW_PX, WIDEST_PX = 1280, 1150, 20_000
"""Pages narrower than the first have the recorded build docked narrower, than the second folded up to a strip."""
PANEL_WIDTH_PX = 340


@dataclass(frozen=True, eq=False)
class Parts:
    """The panels of a page."""

    judge: JudgePanel | None
    map: MapPanel
    robot: RobotControl
    build: BuildPanel
    steps: StepsPanel
    instance: InstancePanel
    why: WhyPanel
    page: HelpPanel
    """Help, keys, light and dark."""
    others: ExtraPanels
    """Those that `Services.panels` names."""
    between: list[viser.PanelHandle]
    """Hold room until the page has been laid out."""

    recording: viser.PanelHandle | None
    """Where the recorded build is docked."""

    def settle(self, page_px: object) -> None:
        """The page has been laid out: give the room to the main panel, and the map its share of a narrow page.

        Args:
            page_px: width of the page, as it told it.
        """
        while self.between:
            self.between.pop().remove()
        if self.recording is not None and isinstance(page_px, int | float) and 0 < page_px < WIDEST_PX:
            if page_px < NARROW_PX:
                self.recording.minimize()
            else:
                self.recording.set_width(recording_width(page_px))

    def map_changed(self, simap: SIMap) -> None:
        """Another map is shown."""
        self.build.map_changed(simap)
        self.instance.list(simap)
        self.others.map_changed(simap)

    def close(self) -> None:
        """Stop what runs by itself."""
        self.build.stop()
        self.steps.stop()
        self.robot.close()
        if self.judge is not None:
            self.judge.close()
        self.others.close()


def set_the_table(server: viser.ViserServer) -> None:
    """Do what is the same for all pages, before the first one comes."""
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(22, 110, 235))
    server.gui.set_panel_label("SI Maps workbench")
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(PANEL_WIDTH_PX)


def lay_out(session: "Session") -> Parts:
    """Build all panels of a page."""
    gui, services = session.gui, session.common.services
    wide = "position:fixed;width:100vw;height:0;border:0;visibility:hidden"  # it tells the page's width
    gui.add_html(f'<iframe title="Tab" style="{wide}" src="{session.common.tabs.url_for(session.token)}"></iframe>')
    recording = _dock_recording(session)
    known = [(spec.title, OTHER_TABS[spec.title]) for spec in services.panels if spec.title in OTHER_TABS]
    page = HelpPanel(gui, _page_actions(session), other_tabs=known)
    tabs = gui.add_tab_group()
    others = ExtraPanels(session, services.panels)
    others.place("front", tabs)
    opened = {name: tabs.add_tab(name, icon) for name, icon in BUILT_IN if name != JUDGE or services.judging}
    judge = None
    if services.judging is not None:
        with opened[JUDGE]:
            judge = _judge_panel(session)
    with opened["Map"]:
        map_panel = _map_panel(session)
    with opened["Command"]:
        robot = _robot(session, judge)
    with opened["Build"]:
        build = BuildPanel(
            gui,
            session.simap,
            on_frame=session.time.show_frame,
            recorded=session.common.recording is not None,
            building=session.common.building,
        )
        steps = StepsPanel(gui, session.time.show_step, lambda step: words_beside(session, step))
    others.place("tab", tabs)
    objects = gui.add_panel()
    with objects.add_tab(INSTANCE, viser.Icon.CUBE):
        FindBox(gui, lambda: session.simap, lambda one: _go_to(session, one), lambda: session.selected)
        instance = InstancePanel(gui, session.simap, session.select, session.jump)
        why = WhyPanel(session.client, _why_actions(session))
    others.place("instance", objects)
    between = _dock_small(session, objects)
    return Parts(judge, map_panel, robot, build, steps, instance, why, page, others, [between], recording)


def _go_to(session: "Session", one: Instance) -> None:
    """Select an object, and look at it and what is around it."""
    session.select(one.id)
    (xmin, ymin, _), (xmax, ymax, _) = one.aabb_m
    session.viewpoints.look_at(with_margin((xmin, ymin, xmax, ymax), share=1.0, least_m=1.5))


def _dock_small(session: "Session", objects: viser.PanelHandle) -> viser.PanelHandle:
    """Put a panel below the main one such that it gets a third of the height once what this gives is removed.

    viser 1.1.1 halves the space on docking and has no heights for docked panels: another one, docked between the two
    and taken away when the page has them, leaves them two thirds and one.
    """
    between = session.gui.add_panel()
    between.add_tab("Between")
    between.dock_below(session.gui.main_panel)
    objects.dock_below(between)
    return between


def recording_width(page_px: float) -> float:
    """How wide the recorded build is docked on a page of some width, px: a quarter, or 400 where there is room."""
    return max(0.25 * page_px, RECORDING_WIDTH_PX if page_px >= ROOMY_PX else 0.0)


def _dock_recording(session: "Session") -> viser.PanelHandle | None:
    if session.recording.url is None:
        return None
    panel = session.gui.add_panel()
    with panel.add_tab("Recorded build", viser.Icon.MOVIE):
        back = session.gui.add_button("Back to this map's build", icon=viser.Icon.ARROW_BACK_UP, visible=False)
        back.on_click(lambda _: session.recording.show(None))
        session.recording.on_switch = lambda foreign: setattr(back, "visible", foreign)
        session.gui.add_html(
            f'<iframe title="Recorded build" src="{session.recording.url}" '
            'style="width:100%;height:calc(100vh - 92px);border:0;display:block"></iframe>'
        )
    panel.dock_left()
    panel.set_width(RECORDING_WIDTH_PX)
    return panel


def _judge_panel(session: "Session") -> JudgePanel:
    services = session.common.services
    assert services.judging is not None
    return JudgePanel(
        session.gui,
        session.scene,
        services.judging,
        simap=session.simap,
        candidates=services.candidates,
        take_robot=session.leave_robot,
        lock=session.common.judging,
    )


def _map_panel(session: "Session") -> MapPanel:
    services = session.common.services
    return MapPanel(
        session.gui,
        session.base,
        MapActions(session.partition, session.repaint, session.look, session.time.finish),
        with_k=services.repartition is not None,
        with_resolution=services.recommunity is not None,
    )


def _page_actions(session: "Session") -> PageActions:
    def play() -> None:
        session.parts.build.toggle()

    return PageActions(
        play=play,
        step=lambda frames: session.jump(session.frame + frames),
        clear=lambda: session.select(None),
        look=session.look,
        set_theme=session.set_theme,
    )


def _robot(session: "Session", judge: JudgePanel | None) -> RobotControl:
    viewpoints = session.viewpoints

    def on_use() -> None:
        session.time.finish()  # commands are carried out on the finished map
        if judge is not None:
            judge.leave()

    return RobotControl(
        session.gui,
        session.scene,
        session.command_worker,
        session.common.services,
        current_map=lambda: session.simap,
        start=session.common.start,
        follower=Follower(session.client, behind=lambda: viewpoints.name == SLANT, let_go=viewpoints.restore),
        on_use=on_use,
    )


def _why_actions(session: "Session") -> WhyActions:
    return WhyActions(
        repaint=session.repaint,
        show_frame=session.jump,
        show_joint=session.time.show_joint,
        knows_joint=lambda simap: session.common.recording and simap.merges is session.common.recorded.merges,
        submit=session.worker.submit,
        view=session.view,
    )
