"""Runs in Home Assistant's environment: evaluates announcements as its discovery does.

Reads a JSON list of objects: ``prefix``, ``topic``, ``config``, ``now`` (seconds since 1970), and
payloads: ``states``, ``statuses``. Writes what Home Assistant makes of each, or ends with its
refusal.
"""

from __future__ import annotations

import asyncio
import json
import sys
from datetime import UTC, datetime
from typing import Any
from unittest.mock import patch

from homeassistant.components.mqtt import binary_sensor
from homeassistant.components.mqtt.discovery import TOPIC_MATCHER
from homeassistant.components.mqtt.mixins import MQTT_ENTITY_DEVICE_INFO_SCHEMA
from homeassistant.components.mqtt.models import MqttValueTemplate
from homeassistant.components.mqtt.sensor import DISCOVERY_SCHEMA, MQTT_SENSOR_ATTRIBUTES_BLOCKED
from homeassistant.components.sensor import DEVICE_CLASS_UNITS
from homeassistant.core import HomeAssistant
from homeassistant.util import dt as dt_util


async def judge(asked: dict[str, Any]) -> dict[str, Any]:
    """What Home Assistant makes of an announcement."""
    found = TOPIC_MATCHER.match(asked["topic"].removeprefix(asked["prefix"] + "/"))
    assert found is not None, "Home Assistant looks at no such topic"
    if found["component"] == "binary_sensor":
        return judge_binary(found.groupdict(), asked)
    config = DISCOVERY_SCHEMA(json.loads(asked["config"]))
    MQTT_ENTITY_DEVICE_INFO_SCHEMA(config["device"])
    kind, unit = config.get("device_class"), config.get("unit_of_measurement")
    assert kind is None or unit in DEVICE_CLASS_UNITS[kind], f"{kind} is not measured in {unit}"
    hass = HomeAssistant("/nowhere")
    now = datetime.fromtimestamp(asked["now"], UTC)  # it may have taken long to come as far as this

    def rendered(template: Any, payloads: list[str]) -> list[Any]:
        template.hass = hass
        value = MqttValueTemplate(template, hass=hass)
        with patch.object(dt_util, "now", lambda: now):
            return [value.async_render_with_possible_json_value(each) for each in payloads]

    attributes = rendered(config["json_attributes_template"], asked["states"])
    return {
        **found.groupdict(),
        "device_class": kind,
        "unit": unit,
        "states": rendered(config["value_template"], asked["states"]),
        "attributes": [
            sorted({*json.loads(each)} - MQTT_SENSOR_ATTRIBUTES_BLOCKED) for each in attributes
        ],
        "available": [
            {config["payload_available"]: True, config["payload_not_available"]: False}[each]
            for each in rendered(config["availability_template"], asked["statuses"])
        ],
        "expire_after": config["expire_after"],
    }


def judge_binary(found: dict[str, Any], asked: dict[str, Any]) -> dict[str, Any]:
    """What Home Assistant makes of the announcement of a binary sensor."""
    config = binary_sensor.DISCOVERY_SCHEMA(json.loads(asked["config"]))
    MQTT_ENTITY_DEVICE_INFO_SCHEMA(config["device"])
    hass = HomeAssistant("/nowhere")

    def rendered(template: Any) -> list[Any]:
        template.hass = hass
        value = MqttValueTemplate(template, hass=hass)
        return [value.async_render_with_possible_json_value(each) for each in asked["states"]]

    states = {config["payload_on"]: True, config["payload_off"]: False}
    attributes = rendered(config["json_attributes_template"])
    return {
        **found,
        "device_class": config["device_class"],
        "states": [states[each] for each in rendered(config["value_template"])],
        "attributes": [sorted(json.loads(each)) for each in attributes],
    }


async def judge_all(asked: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What it makes of each."""
    return [await judge(each) for each in asked]


sys.stdout.write(json.dumps(asyncio.run(judge_all(json.load(sys.stdin)))))
