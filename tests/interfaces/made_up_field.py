"""Checks one made-up response field, ``heat``, which is declared in one place and nowhere else.

python made_up_field.py DATASET MAKE_CONFIGURATION
"""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

BEFORE = "    tangent: CellTangent | None = field("
DECLARATION = '    heat: Array | None = field(default=None, metadata=row("E", "Made-up heat.", 2))\n'

spec = importlib.util.find_spec("porocore.states")
source = Path(spec.origin).read_text(encoding="utf-8")
assert source.count(BEFORE) == 1
states = importlib.util.module_from_spec(spec)
sys.modules["porocore.states"] = states
exec(compile(source.replace(BEFORE, DECLARATION + BEFORE), spec.origin, "exec"), vars(states))

import h5py  # noqa: E402
import numpy as np  # noqa: E402

from porocore import InputSpace, MacroState, Status, failed_response  # noqa: E402
from porocore.core.field_check import response_fault  # noqa: E402
from porocore.interfaces.records import SolvedState, build_response, flatten_response  # noqa: E402
from porocore.sampling.datasets.dataset import Dataset  # noqa: E402

path, generator = map(Path, sys.argv[1:])
inputs = InputSpace.from_ranges({"p": (0.0, 1.0)})
shapes = {
    name: declared.row_shape(2)
    for name, declared in states.CELL_FIELDS.items()
    if declared.flag != "undeformed"
}

# The conditions of every field hold for it: shape, numbers, NaN.
failed = failed_response(Status.inverted, deformed=True, parameters=2)
assert failed.heat.shape == (1, 2)
assert np.isnan(failed.heat).all()
solved = build_response([0], {name: np.full((1, *shape), 0.5) for name, shape in shapes.items()})
assert response_fault(solved, 1) is None
assert response_fault(replace(solved, heat=np.full((1, 2), np.nan)), 1).startswith("heat: row 0")
assert response_fault(replace(solved, heat=np.zeros((1, 3))), 1).startswith("heat: expected shape (1, 2)")

# The file of solved states has it, merged and read again, and so has every part of the data.
dataset = Dataset.create(path, inputs=inputs, identity="made-up")
for i, response in enumerate((solved, failed, solved)):
    dataset.append(SolvedState(f"state {i}", (i / 4,), MacroState.zeros(1), response, 1.0))
dataset.consolidate()
with h5py.File(path) as file:
    assert file["response/heat"].shape == (3, 2)
read = Dataset.open(path).responses()
np.testing.assert_array_equal(read.heat, [[0.5, 0.5], [np.nan, np.nan], [0.5, 0.5]])
np.testing.assert_array_equal(read[[2, 1]].heat, [[0.5, 0.5], [np.nan, np.nan]])
np.testing.assert_array_equal(read[read.valid].heat, [[0.5, 0.5], [0.5, 0.5]])
assert states.CellResponse.concatenate([read, solved]).heat.shape == (4, 2)
assert flatten_response(read)["heat"].shape == (3, 2)

# The documentation says what it is: the class and the table of the page.
assert "heat : (n, 2)\n        Made-up heat. [E]" in states.CellResponse.__doc__
sys.path.insert(0, str(generator.parent))
import make_configuration  # noqa: E402

page = make_configuration.with_tables((generator.parent / "cell.md").read_text(encoding="utf-8"))
assert "| `heat` | (n, 2) | E | Made-up heat |" in page
print("found everywhere")
