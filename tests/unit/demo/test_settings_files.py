"""The files that the demo writes can be moved with the folder that they lie in."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_cloud.settings import CloudSettings
from eskin_gateway.settings import GatewaySettings
from eskin_sensor_node.settings import NodeSettings

from eskin.demo.layout import Layout
from eskin.demo.settings_files import Ports, write_cloud, write_gateway, write_node
from eskin.mosquitto import BrokerPorts

if TYPE_CHECKING:
    from pathlib import Path


def test_data_folder_can_be_moved(tmp_path: Path) -> None:
    before, after = tmp_path / "eskin-data", tmp_path / "elsewhere" / "moved"
    layout, ports = Layout(before), Ports(8080, 8443, BrokerPorts(8883, 8884, 8885), 9464)
    files = [write_cloud(layout, ports), write_gateway(layout, ports), write_node(layout, "palm")]
    assert not any(str(tmp_path) in file.read_text() for file in files)
    after.parent.mkdir()
    before.rename(after)
    cloud_file, gateway_file, node_file = (after / file.relative_to(before) for file in files)

    cloud = CloudSettings.load(cloud_file)
    gateway = GatewaySettings.load(gateway_file)
    node = NodeSettings.load(node_file)
    moved = Layout(after)
    for found, expected in (
        (cloud.store.path, moved.store),
        (cloud.gateways.identity, moved.identity("server.cloud")),
        (cloud.keys.directory, moved.cloud_keys),
        (gateway.spool.path, moved.spool),
        (gateway.keys.directory, moved.keys),
        (node.flash.path, moved.flash("palm")),
        (node.truth.path, moved.truth("palm")),
        (node.identity.directory, moved.identity("palm")),
    ):
        assert found is not None
        assert found.resolve() == expected.resolve()
