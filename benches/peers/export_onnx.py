"""Exports a network to ONNX, so that other engines run exactly the same description.

Usage: export_onnx.py {compact|vgg16} SIDE_PX OUT.onnx     (needs torch, onnx)
Input: the normalised picture, 1 x 3 x SIDE x SIDE. Outputs: heatmap (1 x 1 x SIDE x SIDE, after softmax and shuffle),
descriptors (1 x D x SIDE/8 x SIDE/8) and the global descriptor (1 x 512, whitened): all that grimnet computes before choosing
keypoints. The numbers are those of the goldens; they do not change the time.
"""
import os
import sys
import torch
import torch.nn.functional as F

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../crates/net/tests/golden'))
from network import Network, compact, fill, vgg16  # noqa: E402


class Exported(torch.nn.Module):
    def __init__(self, spec):
        super().__init__()
        self.net = Network(spec, fill(spec), 'uav')

    def forward(self, x):
        logits, descriptors, vector = self.net(x)
        return F.pixel_shuffle(logits.softmax(1)[:, :64], 8), descriptors, vector


def export(preset, side, path):
    net = Exported({'compact': compact, 'vgg16': vgg16}[preset]()).eval()
    with torch.no_grad():
        torch.onnx.export(net, (torch.zeros(1, 3, side, side),), path, input_names=['image'],
                          output_names=['heatmap', 'descriptors', 'global'], opset_version=17, dynamo=False)


if __name__ == '__main__':
    export(sys.argv[1], int(sys.argv[2]), sys.argv[3])
