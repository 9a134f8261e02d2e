"""Quantises an exported network to int8 for OpenVINO, with NNCF, as OpenVINO's documentation does it.

Usage: quantise.py MODEL.onnx OUT.xml [--pictures FOLDER]     (a file that export_onnx.py wrote; needs openvino, nncf, numpy, pillow)
Without pictures it is calibrated on noise, which is enough for timing with network.py.
"""
import argparse
import pathlib
import nncf
import numpy as np
import openvino

MEAN, STD = 0.45, 0.25                                                                  # of `compact`
KINDS = {'.jpg', '.jpeg', '.png', '.tif', '.tiff'}


def pictures(folder, shape, most):
    from PIL import Image
    paths = [p for p in sorted(pathlib.Path(folder).rglob('*')) if p.suffix.lower() in KINDS]
    for path in paths[::max(1, len(paths) // most)][:most]:
        picture = Image.open(path).convert('RGB').resize((shape[3], shape[2]))
        yield ((np.asarray(picture, np.float32) / 255 - MEAN) / STD).transpose(2, 0, 1)[None]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('model')
    parser.add_argument('out')
    parser.add_argument('--pictures')
    parser.add_argument('--most', type=int, default=30)
    arguments = parser.parse_args()
    model = openvino.Core().read_model(arguments.model)
    shape = list(model.input(0).shape)
    if arguments.pictures:
        items = list(pictures(arguments.pictures, shape, arguments.most))
    else:
        items = [np.random.default_rng(i).normal(size=shape).astype(np.float32) for i in range(10)]
    quantised = nncf.quantize(model, nncf.Dataset(items), preset=nncf.QuantizationPreset.MIXED, subset_size=len(items))
    openvino.save_model(quantised, arguments.out, compress_to_fp16=False)


if __name__ == '__main__':
    main()
