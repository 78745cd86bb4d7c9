# %% [markdown]
# # Reading a skin
# Start `eskin demo`, wait an instant, and run this file cell by cell (Jupyter, VS Code, Spyder), or as a whole:
# `python docs/examples/read_a_skin.py eskin-data/access.json`.

# %% Connect
import json
import sys
from pathlib import Path

import eskin

access = json.loads(
    Path(sys.argv[1] if len(sys.argv) > 1 else "eskin-data/access.json").read_text()
)
client = eskin.connect(access["url"], access["token"])

# %% What there is
for node in client.nodes():
    print(node["id"], node["health"], [channel["id"] for channel in client.channels(node["id"])])

# %% All samples of a channel: a tube for each stretch without a gap, with a progress bar where it takes long
tubes = client.series("fingertip", "t01.capacitance")
tube = max(tubes, key=len)
print(
    f"{len(tubes)} stretches, {sum(map(len, tubes))} samples of {tube.dt / 1e6:g} ms in {tube.unit}"
)
print(
    f"the truth at the first instant lies in {tube.values[0]}; known to {tube.time_error / 1e6:g} ms"
)

# %% How often was the finger touched? Every signal inside the band has the certain peaks.
peaks = eskin.find_peaks(tube, prominence=20e-12)
fewest, most = peaks.total
print(f"between {fewest} and {most} touches")

# %% Was it above 60 pF? Certain where the whole interval is, possible where some of it is.
certain = tube.values.inf > 60e-12
possible = tube.values.sup > 60e-12
print(
    f"above 60 pF: {certain.mean():.1%} of the samples for certain, {possible.mean():.1%} possibly"
)
