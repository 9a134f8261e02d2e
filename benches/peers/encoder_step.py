"""Times one training step through the VGG-16 encoder with batch normalisation in PyTorch, forward and backward, on the CPU.

Usage: encoder_step.py [SIDE_PX [PICTURES]]. Compare with `cargo run --release -p grimnet-train --example encoder_step`, with
nothing else on the machine; quote the ratio.
"""
import statistics
import sys
import time

import torch
from torch import nn

RUNS = 5
side = int(sys.argv[1]) if len(sys.argv) > 1 else 256
count = int(sys.argv[2]) if len(sys.argv) > 2 else 2
layers, inputs = [], 3
for widths in [(64, 64), (128, 128), (256,) * 3, (512,) * 3, (512,) * 3]:
    for outputs in widths:
        layers += [nn.Conv2d(inputs, outputs, 3, padding=1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU()]
        inputs = outputs
    layers.append(nn.MaxPool2d(2))
# Channels last is the faster layout for PyTorch's CPU convolutions; both are timed.
for layout in (torch.contiguous_format, torch.channels_last):
    network = nn.Sequential(*layers).train().to(memory_format=layout)
    pictures = torch.randn(count, 3, side, side).to(memory_format=layout)
    times = []
    for _ in range(RUNS + 1):
        network.zero_grad()
        start = time.perf_counter()
        network(pictures).square().mean().backward()
        times.append((time.perf_counter() - start) * 1e3)
    print(f"{count} x {side} x {side} {layout}: best {min(times[1:]):.0f} ms, median {statistics.median(times[1:]):.0f} ms")
