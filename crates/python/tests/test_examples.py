"""The examples run on the demo."""

import json
import pathlib
import re
import subprocess
import sys

EXAMPLES = pathlib.Path(__file__).resolve().parents[3] / "examples" / "python"


def test_the_notebook_runs(demo, monkeypatch):
    monkeypatch.setenv("GRIMNET_DEMO", str(demo))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    notebook = json.loads((EXAMPLES / "from_map_to_positions.ipynb").read_text())
    assert all(not cell.get("outputs") for cell in notebook["cells"]), "outputs are not committed"
    names = {}
    for number, cell in enumerate(notebook["cells"]):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"cell {number}", "exec"), names)
    assert names["errors_m"] and max(names["errors_m"]) < 10.0
    assert "tracking" in [point.state for point in names["points"]]


def test_the_evaluation(demo):
    command = [sys.executable, EXAMPLES / "evaluate.py", demo / "area.grim", demo / "photos", demo / "truth.csv"]
    printed = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    shares = [float(share) for share in re.findall(r"A@\d+m ([\d.]+)%", printed)]
    assert len(shares) == 3 and shares == sorted(shares) and shares[-1] >= 75.0, printed


def test_the_blocks_of_the_documentation_run(demo, tmp_path, monkeypatch):
    text = (EXAMPLES.parents[1] / "docs" / "python.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)
    assert len(blocks) >= 5
    (tmp_path / "demo").symlink_to(demo)
    monkeypatch.chdir(tmp_path)
    names = {}
    for number, block in enumerate(blocks):
        exec(compile(block, f"docs/python.md, block {number}", "exec"), names)
    assert names["point"].state == "tracking"
