"""Writes one small state dictionary in every format that the importer reads, and weights with the names and shapes of torchvision's
VGG-16, which take 20 kB because all are views of the same numbers. Needs torch and safetensors."""
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


def fraction(count):
    """Numbers from 0 to 1 without a pattern (Knuth's multiplicative hash)."""
    return torch.tensor([k * 2654435761 % 2**32 / 2**32 for k in range(count)], dtype=torch.float64)


def vgg16(bn):
    """The encoder's state dictionary: `features.N` of torchvision's `vgg16`, of `vgg16_bn` with `bn`."""
    signed, positive = (0.1 * (fraction(5120) - 0.5)).float(), (0.5 + fraction(512)).float()
    out, index, inputs = collections.OrderedDict(), 0, 3
    for widths in [(64, 64), (128, 128), (256,) * 3, (512,) * 3, (512,) * 3]:
        for width in widths:
            out[f"features.{index}.weight"] = signed.as_strided((width, inputs, 3, 3), (4, 5, 3, 1))
            out[f"features.{index}.bias"] = signed[:width]
            if bn:
                norm = f"features.{index + 1}"
                out[f"{norm}.weight"], out[f"{norm}.running_var"] = positive[:width], positive[:width]
                out[f"{norm}.bias"], out[f"{norm}.running_mean"] = signed[:width], signed[:width]
                out[f"{norm}.num_batches_tracked"] = torch.tensor(7)
            index, inputs = index + (3 if bn else 2), width
        index += 1
    return out


torch.save(vgg16(False), here / "vgg16.pth")
# torchvision's own files are of this older format.
torch.save(vgg16(True), here / "vgg16_bn.pth", _use_new_zipfile_serialization=False)
