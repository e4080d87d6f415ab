"""Runs an example and checks that it measured what it says. usage: run_example.py EXAMPLE ARGUMENT..."""

import re
import subprocess
import sys

output = subprocess.run([sys.executable, *sys.argv[1:]], capture_output=True, text=True)
assert output.returncode == 0, output.stderr
found = dict(re.findall(r"^(.*): ([0-9.]+) decisions, mean of 20 episodes$", output.stdout, re.M))
assert set(found) == {"equal split", "soft actor-critic"}, output.stdout
# The mean of an equal split on these episodes is known from the registry; a policy that acts outside its space would have ended in an error.
assert all(float(value) > 20 for value in found.values()), found
