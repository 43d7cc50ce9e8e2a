"""GraphML, opened with networkx, and the scene graph, opened with spark_dsg."""

import json

import networkx as nx
import numpy as np
import pytest
import spark_dsg
from toy_maps import map_from_drawing, toy_map

from simaps_viz import ExportOptions, InputError, export_map, to_networkx
from simaps_viz.exports.graphs import NO_LABEL, OBJECTS, ROOMS, node_number


@pytest.mark.parametrize("label", ["chair", "dining table", None])
def test_graphml_gives_networkx_the_graph_back(tmp_path, label):
    simap = toy_map()
    read = nx.read_graphml(export_map(simap, tmp_path / "g.graphml", options=ExportOptions(label=label))[0])
    labels = [label] if label else ["chair", "couch", "dining table", "potted plant"]
    expected = nx.Graph()
    for name in labels:
        graph = to_networkx(simap, name)
        for (row, col), data in graph.nodes(data=True):
            expected.add_node(f"{row},{col}", label=name, **data)
        for (row_a, col_a), (row_b, col_b), data in graph.edges(data=True):
            expected.add_edge(f"{row_a},{col_a}", f"{row_b},{col_b}", **data)
    assert set(read.nodes) == set(expected.nodes) and len(expected) > 0
    for node, data in expected.nodes(data=True):
        assert {key: read.nodes[node][key] for key in data} == pytest.approx(data)
        row, col = (int(v) for v in node.split(","))
        found = read.nodes[node]
        assert (found["row"], found["col"]) == (row, col)
        assert (found["x_m"], found["y_m"]) == pytest.approx(simap.spec.centre_of(row, col))
    assert {frozenset(edge) for edge in read.edges} == {frozenset(edge) for edge in expected.edges}
    for a, b, data in expected.edges(data=True):
        assert read.edges[a, b] == pytest.approx(data)
    assert read.graph["cell_size_m"] == 0.05 and not read.is_directed()


def test_graphml_of_a_class_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"'piano'.*chair, couch"):
        export_map(toy_map(), tmp_path / "g.graphml", options=ExportOptions(label="piano"))
    assert not list(tmp_path.iterdir())


def test_graphml_escapes_names(tmp_path):
    simap = map_from_drawing("A.", {"A": "couch"})
    object.__setattr__(simap, "provenance", {"name": 'a <b> & "c" ]]> \x07!'})
    assert nx.read_graphml(export_map(simap, tmp_path / "g.graphml")[0]).graph["name"] == 'a <b> & "c" ]]>  !'


def test_scene_graph_has_spark_dsgs_fields(tmp_path):
    simap = toy_map()
    (path,) = export_map(simap, tmp_path / "g.json", "spark-dsg")
    graph = json.loads(path.read_text())
    assert graph["SPARK_DSG_header"]["project_name"] == "main"
    assert node_number("O", 7) == 5692549928996306951  # as spark_dsg.NodeSymbol("O", 7).value gives it
    objects = {n["id"]: n for n in graph["nodes"] if n["layer"] == OBJECTS}
    rooms = {n["id"]: n["attributes"] for n in graph["nodes"] if n["layer"] == ROOMS}
    assert sorted(rooms) == [node_number("R", room.id) for room in simap.rooms] and len(rooms) == 2
    edges = [(e["source"], e["target"]) for e in graph["edges"]]
    assert edges[-1] == tuple(sorted(rooms))  # the door
    assert sorted(edges[:-1]) == sorted(
        (node_number("R", r.id), node_number("O", i)) for r in simap.rooms for i in r.objects
    )
    assert sorted(target for _, target in edges[:-1]) == sorted(objects)
    assert [one["name"] for one in rooms.values()] == [room.name for room in simap.rooms]
    for room, found in zip(simap.rooms, rooms.values(), strict=True):
        box, (x, y) = found["bounding_box"], np.array(room.polygon_m).T
        assert found["semantic_label"] == NO_LABEL
        assert box["dimensions"][:2] == pytest.approx([np.ptp(x), np.ptp(y)], abs=0.06)
    for one in simap.instances:
        found = objects[node_number("O", one.id)]["attributes"]
        assert found["type"] == "ObjectNodeAttributes" and found["name"] == f"{one.label}-{one.id}"
        assert found["position"] == pytest.approx(one.centroid_m)
        assert simap.grid.labels[found["semantic_label"]] == one.label
        box = found["bounding_box"]
        for k in range(2):
            half = box["dimensions"][k] / 2
            assert box["world_P_center"][k] - half == pytest.approx(one.aabb_m[0][k])
            assert box["world_P_center"][k] + half == pytest.approx(one.aabb_m[1][k])
        assert box["world_P_center"][2] == pytest.approx(one.aabb_m[1][2] / 2)
    labelspace = dict(graph["metadata"]["labelspaces"][f"_l{OBJECTS}p0"])
    assert labelspace == dict(enumerate(simap.grid.labels))


def test_spark_dsg_opens_the_scene_graph(tmp_path):
    simap = toy_map()
    graph = spark_dsg.DynamicSceneGraph.load(str(export_map(simap, tmp_path / "g.json", "spark-dsg")[0]))
    nodes = {node.attributes.name: node for node in graph.get_layer(spark_dsg.DsgLayers.OBJECTS).nodes}
    assert set(nodes) == {f"{one.label}-{one.id}" for one in simap.instances}
    names = graph.get_labelspace(OBJECTS).labels_to_names
    for one in simap.instances:
        node = nodes[f"{one.label}-{one.id}"]
        assert node.attributes.position == pytest.approx(one.centroid_m)
        assert names[node.attributes.semantic_label] == one.label
        assert node.id.value == node_number("O", one.id) and node.has_parent()
        assert node.attributes.bounding_box.dimensions[2] == pytest.approx(one.aabb_m[1][2], abs=1e-6)


def test_an_empty_map_has_a_scene_graph(tmp_path):
    graph = json.loads(export_map(map_from_drawing("??"), tmp_path / "e.json", "spark-dsg")[0].read_text())
    assert graph["nodes"] == graph["edges"] == []
