"""The files that the demo writes can be moved with the folder that they lie in."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_cloud.settings import CloudSettings
from eskin_gateway.settings import GatewaySettings
from eskin_sensor_node.settings import NodeSettings

from eskin.demo.layout import DemoFolder
from eskin.demo.settings_files import (
    Ports,
    node_profiles,
    write_cloud,
    write_gateway,
    write_node,
)
from eskin.errors import SettingsError
from eskin.mosquitto import BrokerPorts

if TYPE_CHECKING:
    from pathlib import Path


def test_data_folder_can_be_moved(tmp_path: Path) -> None:
    before, after = tmp_path / "eskin-data", tmp_path / "elsewhere" / "moved"
    layout, ports = DemoFolder(before), Ports(8080, 8443, BrokerPorts(8883, 8884, 8885), 9464)
    node = write_node(layout, "palm", "palm")
    files = [write_cloud(layout, ports), write_gateway(layout, ports), node]
    assert not any(str(tmp_path) in file.read_text() for file in files)
    after.parent.mkdir()
    before.rename(after)
    cloud_file, gateway_file, node_file = (after / file.relative_to(before) for file in files)

    cloud = CloudSettings.load(cloud_file)
    gateway = GatewaySettings.load(gateway_file)
    own = NodeSettings.load(node_file)
    moved = DemoFolder(after)
    for found, expected in (
        (cloud.store.path, moved.store),
        (cloud.gateways.identity, moved.identity("server.cloud")),
        (cloud.keys.directory, moved.cloud_keys),
        (gateway.spool.path, moved.spool),
        (gateway.keys.directory, moved.keys),
        (own.flash.path, moved.flash("palm")),
        (own.truth.path, moved.truth("palm")),
        (own.identity.directory, moved.identity("palm")),
    ):
        assert found is not None
        assert found.resolve() == expected.resolve()


def test_nodes_take_the_profiles_in_turn_or_one_skin() -> None:
    assert list(node_profiles(5)) == ["fingertip", "palm", "forearm", "hand", "fingertip-2"]
    assert node_profiles(5)["fingertip-2"] == "fingertip"
    assert node_profiles(2, "paper-hand") == {
        "paper-hand": "paper-hand",
        "paper-hand-2": "paper-hand",
    }
    with pytest.raises(SettingsError, match=r"--skin.*'palm'.*paper-hand"):
        node_profiles(1, "palm")


def test_node_of_a_skin_has_its_profile(tmp_path: Path) -> None:
    written = write_node(DemoFolder(tmp_path), "paper-hand-2", "paper-hand")
    settings = NodeSettings.load(written)
    assert settings.node.name == "paper-hand-2"
    assert len(settings.skin.skin) == 8400
