"""A fake of habitat_sim: the parts of its published interface that apps/render_habitat.py calls, over the scans' scene.

Names, arguments, axes, dtypes and shapes are those of Habitat-Sim's bindings and of its agent.py; what the real one
refuses (an unknown setting, a quaternion that is not of unit length) the fake refuses too. It is no proof that the real
one behaves so.
"""

from types import SimpleNamespace

import numpy as np
from scans import COLORS, GL, LABELS, Y_UP, look

from simaps_viz.geometry import map_from_world
from simaps_viz.structures import Intrinsics


class _Settings:
    """Takes the attributes that the real class has, and no others."""

    known: tuple[str, ...] = ()

    def __init__(self):
        self.__dict__.update(dict.fromkeys(self.known))

    def __setattr__(self, name, value):
        assert name in self.known, f"habitat_sim.{type(self).__name__} has no {name}"
        self.__dict__[name] = value


class SimulatorConfiguration(_Settings):
    known = ("scene_id", "scene_dataset_config_file", "gpu_device_id", "enable_physics")


class CameraSensorSpec(_Settings):
    known = ("uuid", "sensor_type", "sensor_subtype", "resolution", "hfov", "position", "orientation")


class AgentConfiguration(_Settings):
    known = ("sensor_specifications",)


class AgentState(_Settings):
    known = ("position", "rotation")


def _named(name):
    return None if name is None else SimpleNamespace(name=lambda: name)


class _Box:
    """The older of the two kinds of box."""

    def __init__(self, lift_m=0.0):
        self.center, self.sizes = np.array([0.0, 0.55 + lift_m, 0.0]), np.array([1.0, 0.5, 1.0])


class _Range3D:
    """The newer kind, of Magnum."""

    def center(self):
        return (0.0, 0.55, 0.0)

    def size(self):
        return (1.0, 0.5, 1.0)


def matterport():
    """Return a semantic scene as of Matterport3D, with ids from 0, levels and an entry that is None; ids' offset."""
    upper, level = SimpleNamespace(id="0", aabb=_Box(3.0)), SimpleNamespace(id="1", aabb=_Box())
    region = SimpleNamespace(id="1_1", level=level, aabb=_Box(), category=_named("kitchen"))
    things = [
        SimpleNamespace(id=f"1_1_{i - 1}", semantic_id=i - 1, region=region, aabb=_Box(), category=_named(label))
        for i, label in LABELS.items()
    ]
    return SimpleNamespace(objects=[None, *things], regions=[region], levels=[upper, level]), -1


def hm3d():
    """Return a semantic scene as of HM3D: object 0 is Unknown, no levels, regions without a category; ids' offset."""
    region = SimpleNamespace(id="_3", level=None, aabb=_Range3D(), category=None)
    things = [
        SimpleNamespace(id=f"{label}_{i}", semantic_id=i, region=region, aabb=_Range3D(), category=_named(label))
        for i, label in {0: "Unknown", **LABELS}.items()
    ]
    return SimpleNamespace(objects=things, regions=[region], levels=[]), 0


class Simulator:
    """Renders the scans' scene in a world with y up and the floor at 0.3 m."""

    position = rotation = np.zeros(3)

    def __init__(self, config, made):
        self.semantic_scene, self._offset = made()
        self.specs = config.agents[0].sensor_specifications
        self.renders, self.closed = 0, False

    def initialize_agent(self, number):
        assert number == 0

        def set_state(state):
            assert np.shape(state.position) == (3,) and np.isfinite(state.position).all()
            assert np.shape(state.rotation) == (4,) and abs(np.linalg.norm(state.rotation) - 1) < 1e-4
            self.position, (x, y, z, w) = np.array(state.position), state.rotation
            self.rotation = np.array([
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ])  # fmt: skip

        return SimpleNamespace(set_state=set_state)

    def get_sensor_observations(self):
        pictures = {}
        for spec in self.specs:
            assert spec.sensor_subtype == "pinhole" and list(spec.orientation) == [0, 0, 0]
            (height, width), T = spec.resolution, np.eye(4)
            T[:3, :3], T[:3, 3] = self.rotation, self.position + self.rotation @ np.array(spec.position)
            focal = width / 2 / np.tan(np.radians(spec.hfov) / 2)
            k = Intrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
            depth_m, ids = look(k, map_from_world(Y_UP.up, Y_UP.floor_height_m) @ T @ GL)
            semantic = np.maximum(ids + self._offset, 0).astype(np.uint32)  # beside the mesh it is 0
            color = np.dstack([COLORS[ids], np.full(ids.shape, 255, np.uint8)])
            pictures[spec.uuid] = {"color": color, "depth": depth_m.astype(np.float32), "semantic": semantic}[
                spec.sensor_type
            ]
        self.renders += 1
        return pictures

    def close(self):
        self.closed = True


def module(made):
    """Return the fake module, whose simulators have the semantic scene that ``made`` returns, and all of them."""
    simulators = []

    def simulator(config):
        simulators.append(Simulator(config, made))
        return simulators[-1]

    fake = SimpleNamespace(
        SimulatorConfiguration=SimulatorConfiguration, CameraSensorSpec=CameraSensorSpec, AgentState=AgentState,
        agent=SimpleNamespace(AgentConfiguration=AgentConfiguration), Simulator=simulator,
        SensorType=SimpleNamespace(COLOR="color", DEPTH="depth", SEMANTIC="semantic"),
        SensorSubType=SimpleNamespace(PINHOLE="pinhole"),
        Configuration=lambda simulator, agents: SimpleNamespace(simulator=simulator, agents=agents),
    )  # fmt: skip
    return fake, simulators
