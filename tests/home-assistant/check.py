"""Home Assistant's own mqtt integration, a real mosquitto and a simulated robot: what a person would see there.

Usage: check.py SPYKEE. Part of scripts/check-home-assistant, which installs what it needs.
"""

import asyncio
import contextlib
import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from types import MappingProxyType
from unittest.mock import MagicMock

from homeassistant import bootstrap, config_entries, const, core, loader
from homeassistant.helpers import device_registry, entity_registry

# Nothing that is waited for takes so long.
WAIT_LIMIT = 60
UID = "SPYKEE0001"
WORLD = """
name: check
room: { width: 8, depth: 8 }
station: { at: [0, 4], heading_degrees: 0 }
start: { at: [2, 4], heading_degrees: 180 }
battery: { level: 90, idle_drain_per_minute: 0.01, driving_drain_per_minute: 0.01 }
"""
CONFIG = """
data: data
behaviours: [{ file: patrol.lua }, { file: other.lua }]
mqtt: { host: 127.0.0.1, port: %d }
"""
SCHEDULE = """
time_zone: UTC
schedule: [{ run: patrol, at: "0 9 * * *", for: 30m }]
"""
IDLE = "while true do task.wait(1) end"
DRIVES = "while true do robot.move(20, -20, 0.5) task.wait(1) end"
# Each entity by its part of the unique id, its domain and the name that a person reads.
ENTITIES = [
    ("robot", "vacuum", "{device}"),
    ("battery", "sensor", "{device} Battery"),
    ("charging", "binary_sensor", "{device} Charging"),
    ("problem", "binary_sensor", "{device} Problem"),
    ("next", "sensor", "{device} Next start"),
    ("skip", "switch", "{device} Leave out the next start"),
    ("pause", "text", "{device} Timetable paused until"),
    ("resume", "button", "{device} Resume the timetable"),
    ("camera", "camera", "{device} Camera"),
    ("alarm", "image", "{device} Last alarm"),
    ("event", "event", "{device} Last event"),
    ("dock", "button", "{device} Dock"),
    ("undock", "button", "{device} Undock"),
    ("stop", "button", "{device} Stop"),
    ("reset_stop", "button", "{device} Release STOP"),
    ("snapshot", "button", "{device} Take a picture"),
    ("behaviour", "select", "{device} Behaviour"),
]


class Failed(Exception):
    """A promise that does not hold."""


def say(text):
    print(text, flush=True)


async def until(what, found):
    """Waits for a value that is there."""
    for _ in range(WAIT_LIMIT * 20):
        value = found()
        if value:
            return value
        await asyncio.sleep(0.05)
    raise Failed(f"in {WAIT_LIMIT} s it did not come to this: {what}")


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def broker(folder, port, ended):
    config = folder / "mosquitto.conf"
    config.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\nuser root\n")
    found = shutil.which("mosquitto", path=os.environ["PATH"] + ":/usr/sbin")
    process = subprocess.Popen([found, "-c", config], stderr=subprocess.DEVNULL)
    ended.callback(process.wait)
    ended.callback(process.terminate)


def start(spykee, how, folder, ended):
    """`spykee run --sim` or `spykee serve --sim`, as a person starts it."""
    with open(folder / "run.log", "ab") as log:
        process = subprocess.Popen(
            [spykee, how, "--config", f"{how}.yaml", "--sim", "world.yaml"],
            cwd=folder, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
        )
    ended.callback(process.wait)
    ended.callback(process.kill)
    return process


async def home_assistant(folder, port):
    """Home Assistant with its mqtt integration alone: no pages."""
    hass = core.HomeAssistant(str(folder))
    hass.config.skip_pip = True
    loader.async_setup(hass)
    hass.config_entries = config_entries.ConfigEntries(hass, {})
    await bootstrap.async_load_base_functionality(hass)
    hass.http = MagicMock()
    hass.config.components.add("http")
    entry = config_entries.ConfigEntry(
        version=1, minor_version=2, domain="mqtt", title="broker", source="user", unique_id=None, options={},
        data={"broker": "127.0.0.1", "port": port, "protocol": "3.1.1"}, discovery_keys=MappingProxyType({}), subentries_data=None,
    )
    await hass.config_entries.async_add(entry)
    await hass.async_start()
    if entry.state is not config_entries.ConfigEntryState.LOADED:
        raise Failed(f"the mqtt integration is {entry.state}: {entry.reason}")
    return hass


class Robot:
    """The robot as Home Assistant shows it."""

    def __init__(self, hass):
        self.hass = hass
        self.entities = entity_registry.async_get(hass)

    def id(self, key, domain):
        return self.entities.async_get_entity_id(domain, "mqtt", f"spykee_{UID}_{key}")

    def state(self, key, domain):
        known = self.id(key, domain)
        return known and self.hass.states.get(known)

    async def becomes(self, key, domain, wanted):
        def found():
            state = self.state(key, domain)
            return state if state and state.state == wanted else None
        try:
            return await until(f"{key} is `{wanted}`", found)
        except Failed as failed:
            raise Failed(f"{failed}; it is {self.state(key, domain)}") from None

    async def call(self, domain, service, key, **data):
        data["entity_id"] = self.id(key, domain)
        await self.hass.services.async_call(domain, service, data, blocking=True)


async def entities_appear(robot):
    def available(key, domain):
        state = robot.state(key, domain)
        return state and state.state != const.STATE_UNAVAILABLE
    await until("all entities are available", lambda: all(available(key, domain) for key, domain, _ in ENTITIES))
    devices = device_registry.async_get(robot.hass)
    device = devices.async_get_device(identifiers={("mqtt", f"spykee_{UID}")})
    say(f"one device: {device.name}, {device.manufacturer} {device.model}, {device.sw_version}")
    newest = "default_entity_id" in Path(sys.modules["homeassistant.components.mqtt.const"].__file__).read_text()
    for key, domain, name in ENTITIES:
        state = robot.state(key, domain)
        wanted = name.format(device=device.name)
        if state.name != wanted:
            raise Failed(f"{state.entity_id} is called `{state.name}`, not `{wanted}`")
        if newest and state.entity_id != f"{domain}.{UID.lower()}_{key}":
            raise Failed(f"{state.entity_id} has another id than it asked for")
        say(f"  {state.entity_id}: `{state.name}`, {state.state}")
    there = [e for e in robot.entities.entities.values() if e.platform == "mqtt"]
    missing = {e.unique_id for e in there} ^ {f"spykee_{UID}_{key}" for key, _, _ in ENTITIES}
    if missing:
        raise Failed(f"these entities are not in the list, or too many: {missing}")


async def state_is_shown(robot):
    await robot.becomes("robot", "vacuum", "cleaning")
    await robot.becomes("charging", "binary_sensor", "off")
    await robot.becomes("problem", "binary_sensor", "off")
    battery = await until("the battery has a level", lambda: robot.state("battery", "sensor"))
    if not 80 <= float(battery.state) <= 90:
        raise Failed(f"the battery is {battery.state}")
    options = robot.state("behaviour", "select").attributes["options"]
    if options != ["patrol", "other"]:
        raise Failed(f"the behaviours to choose from are {options}")
    await robot.call("select", "select_option", "behaviour", option="other")
    await robot.becomes("behaviour", "select", "other")
    say("state: cleaning, not charging, no problem, battery, a choice of behaviours that holds")


async def picture_comes(robot):
    from homeassistant.components.camera import DATA_COMPONENT

    await robot.call("button", "press", "snapshot")
    camera = robot.hass.data[DATA_COMPONENT].get_entity(robot.id("camera", "camera"))

    async def picture():
        image = await camera.async_camera_image()
        return image and image[:2] == b"\xff\xd8" and len(image)
    for _ in range(WAIT_LIMIT * 20):
        if size := await picture():
            say(f"the camera shows a JPEG of {size} bytes")
            return
        await asyncio.sleep(0.05)
    raise Failed("no picture came")


async def timetable_can_be_held(robot):
    for service, state in [("turn_on", "on"), ("turn_off", "off")]:
        await robot.call("switch", service, "skip")
        await robot.becomes("skip", "switch", state)
    await robot.call("text", "set_value", "pause", value="2099-01-02 12:00")
    await until("the timetable is paused", lambda: robot.state("pause", "text").state.startswith("2099-01-0"))
    await robot.call("button", "press", "resume")
    await robot.becomes("pause", "text", "")
    say("the next start is left out and taken back, the timetable paused and resumed")


async def goes_home(robot):
    await robot.call("vacuum", "locate", "robot")
    await robot.call("vacuum", "return_to_base", "robot")
    await robot.becomes("robot", "vacuum", "returning")
    await robot.becomes("robot", "vacuum", "docked")
    await robot.becomes("charging", "binary_sensor", "on")

    def docked():
        event = robot.state("event", "event")
        return event and event.attributes.get("event_type") == "dock" and event
    event = await until("the last event is the docking", docked)
    say(f"return_to_base docked the simulated robot: {event.attributes['event_type']} {event.attributes.get('end')}")


async def nothing_old_sticks(robot, process, spykee, folder, ended):
    process.send_signal(signal.SIGKILL)
    for key, domain, _ in ENTITIES:
        await robot.becomes(key, domain, const.STATE_UNAVAILABLE)
    say("killed: all entities are unavailable")
    again = start(spykee, "serve", folder, ended)
    await robot.becomes("robot", "vacuum", "cleaning")
    await robot.becomes("charging", "binary_sensor", "off")
    say("started again: the state is the new one")

    def planned():
        state = robot.state("next", "sensor")
        return state if state and "T09:00:00" in state.state else None
    planned = await until("the timetable's next start is shown", planned)
    if planned.attributes.get("behaviour") != "patrol":
        raise Failed(f"the next start is that of {planned.attributes}")
    say(f"a service with a timetable: next start {planned.state}, patrol")
    return again


async def check(spykee, folder, ended):
    port = free_port()
    broker(folder, port, ended)
    (folder / "run.yaml").write_text(CONFIG % port)
    (folder / "serve.yaml").write_text(CONFIG % port + SCHEDULE)
    (folder / "world.yaml").write_text(WORLD)
    (folder / "patrol.lua").write_text(IDLE)
    (folder / "other.lua").write_text(DRIVES)
    say(f"Home Assistant {const.__version__}")
    hass = await home_assistant(folder / "ha", port)
    robot = Robot(hass)
    process = start(spykee, "run", folder, ended)
    try:
        await entities_appear(robot)
        await state_is_shown(robot)
        await picture_comes(robot)
        await goes_home(robot)
        process = await nothing_old_sticks(robot, process, spykee, folder, ended)
        await timetable_can_be_held(robot)
        # Home Assistant alone is started anew: its birth message, or what is retained, brings all back.
        await hass.async_stop(force=True)
        hass = await home_assistant(folder / "ha2", port)
        await entities_appear(Robot(hass))
        process.send_signal(signal.SIGTERM)
        await Robot(hass).becomes("robot", "vacuum", const.STATE_UNAVAILABLE)
        say("ended in order: unavailable")
    finally:
        await hass.async_stop(force=True)


def main():
    spykee = str(Path(sys.argv[1]).resolve())
    logging.basicConfig(level=logging.ERROR)
    # Pictures are shown as they come: nothing is scaled here.
    logging.getLogger("homeassistant.components.camera.img_util").setLevel(logging.CRITICAL)
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as ended:
        folder = Path(name)
        for made in ("ha", "ha2"):
            (folder / made).mkdir()
            (folder / made / "configuration.yaml").write_text("{}\n")
        try:
            asyncio.run(check(spykee, folder, ended))
        except Failed as failed:
            say(f"FAILED: {failed}")
            say((folder / "run.log").read_text() if (folder / "run.log").exists() else "nothing was run")
            return 1
    say("all good")
    return 0


if __name__ == "__main__":
    sys.exit(main())
