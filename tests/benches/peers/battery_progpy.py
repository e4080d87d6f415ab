"""Simulated cell-seconds per second of progpy's electrochemical battery, one thread, 8 W from full. Prints the rate as JSON.

usage: battery_progpy.py SECONDS
"""

import importlib.metadata
import json
import sys
import time

from progpy.models import BatteryElectroChemEOD

battery = BatteryElectroChemEOD(process_noise=0, measurement_noise=0)
simulated, start = 0, time.perf_counter()
while time.perf_counter() < start + int(sys.argv[1]):
    state = battery.initialize()
    load = battery.InputContainer({"i": 2.0})
    for _ in range(1000):
        voltage = battery.output(state)["v"]
        load["i"] = 8.0 / voltage
        state = battery.next_state(state, load, 1.0)
    simulated += 1000
rate = simulated / (time.perf_counter() - start)
print(json.dumps({"who": f"progpy {importlib.metadata.version('progpy')}", "cell_seconds_per_s": rate}))
