"""What MAVSDK sees on UDP port ``see.py PORT``, in JSON; run where it is installed."""

import json
import sys
import time
from contextlib import suppress

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.param import Param, ParamError, ProtocolVersion
from mavsdk.plugins.telemetry import Telemetry

NAME, VALUE = "AIR_CONFIRM", 4.25


def poll(true, timeout_s=30.0):
    end_s = time.monotonic() + timeout_s
    while not true() and time.monotonic() < end_s:
        time.sleep(0.2)


def main(port):
    seen = {}
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    system = sdk.first_autopilot(60.0)
    poll(lambda: 191 in system.component_ids())
    seen["system"] = system.get_system_id()
    seen["components"] = list(system.component_ids())
    seen["connected"] = system.is_connected()
    telemetry = Telemetry(system)
    rolls = []
    for _ in range(20):
        rolls.append(telemetry.attitude_euler().roll_deg)
        time.sleep(0.1)
    seen["rolls"] = len(set(rolls))
    seen["position"] = [telemetry.position().latitude_deg, telemetry.position().longitude_deg]
    parameters = Param(system)
    with suppress(ParamError):  # it answers "unknown" whatever it did
        parameters.select_component(191, ProtocolVersion.V1)
    before = parameters.get_param_float(NAME)
    parameters.set_param_float(NAME, VALUE)
    seen["parameter"] = [before, parameters.get_param_float(NAME)]
    seen["still"] = system.is_connected()
    print(json.dumps(seen), flush=True)


main(int(sys.argv[1]))
