# %% [markdown]
# # First minutes with intervals
# No server is needed: `make install`, then run this file cell by cell (Jupyter, VS Code, Spyder), or as a whole:
# `.venv/bin/python docs/examples/first_minutes.py`. Write `tube` or `peaks` alone in a cell to see a table.

# %% Numbers that know what they do not know
import numpy as np

import eskin
from eskin import Interval
from eskin.errors import MissingExtraError

resistance = Interval.relative(1e3, 0.001)  # 1 kΩ ± 0.1 %
current = Interval(4.9e-3, 5.1e-3)
voltage = resistance * current
print(voltage, "V")
print(Interval(0.1) + Interval(0.2), "holds 0.3: rounded outward, and thin")

# %% A signal, as a node would measure it: one sample is missing, one is known on one side only
t = np.arange(200) * 0.005
signal = Interval.relative(50e-12 * (1.2 + np.sin(18 * t)), 0.02)
lo, hi = signal.inf.copy(), signal.sup.copy()
lo[90], hi[90] = -np.inf, np.inf
hi[20] = np.inf
tube = eskin.Tube(
    time=(1_790_000_000_000_000_000, 1_790_000_000_000_200_000),  # the first sample's instant, ns
    dt=5_000_000,
    values=Interval(lo, hi),
    unit="F",
    coverage=1.0,
)

# %% Three answers
above = tube.values > 60e-12
print(
    f"above 60 pF: {above.certain.sum()} certain, {above.possible.sum()} possible, "
    f"{above.impossible.sum()} impossible"
)
charge = np.where(above, tube.values, 0.0)  # where it is only possible, both are enclosed
total = np.cumsum(np.clip(charge, 0.0, 200e-12))
print("sum of what is above:", f"{total[-1]:.3g}", "F")

# %% Peaks: certain ones every signal inside the band has
peaks = eskin.find_peaks(tube, prominence=40e-12)
fewest, most = peaks.total
print(f"between {fewest} and {most} peaks")

# %% A model of the paper, and its design
capacitance = eskin.models.capacitance(
    relative_permittivity=Interval(2.9, 3.1),
    area=1e-4,
    distance=Interval.relative(1e-3, 0.02),
)
print(f"plate: {capacitance:.3g} F")

# %% To pandas and xarray and back, with nothing lost; eskin installs neither
try:
    frame = tube.to_pandas()
    print(frame.head(3))
    again = eskin.Tube.from_pandas(frame)
    print("the same tube:", bool(np.all(again.values.equal(tube.values))), tube.to_xarray().sizes)
except MissingExtraError as error:
    print(error)

# %% A picture
axes = tube.plot(peaks=peaks)
axes.set_title("Three touches, or four")
axes.figure.savefig("first_minutes.png", dpi=110)
print("see first_minutes.png")
