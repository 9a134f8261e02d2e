"""Writes one small state dictionary in every format that the importer reads. Needs torch and safetensors."""
import collections
import pathlib

import safetensors.torch
import torch

here = pathlib.Path(__file__).parent
whole = torch.arange(24.0).reshape(4, 6) * 0.5 - 3
state = collections.OrderedDict(
    {
        "features.0.weight": torch.arange(54.0).reshape(2, 3, 3, 3) * 0.01,
        "features.0.bias": torch.tensor([0.25, -0.5]),
        "strided": whole.t()[1:4],  # a view: not contiguous, with an offset
        "features.1.num_batches_tracked": torch.tensor(7),
    }
)
torch.save(state, here / "archive.pth")
torch.save(state, here / "stream.pth", _use_new_zipfile_serialization=False)
torch.save({"state_dict": state, "epoch": 3, "best": 0.5}, here / "nested.pth")
floats = {name: t.contiguous() for name, t in state.items() if t.is_floating_point()}
safetensors.torch.save_file(floats, here / "tensors.safetensors")
