"""Writes the goldens of this folder: what ONNX Runtime says about convolutions of bytes.

Usage: python make_golden.py      (needs onnx, onnxruntime, numpy, safetensors; the tests do not)
Sums are those of the operator ConvInteger; scaling and rounding are done by numpy in f32.
"""
import os
import numpy as np
import onnx.helper
import onnxruntime
from safetensors.numpy import save_file

HERE = os.path.dirname(os.path.abspath(__file__))
# in, out, kernel, stride, height, width
CASES = {
    'wide': (16, 64, 3, 2, 7, 22),
    'deep': (64, 12, 3, 1, 5, 13),
    'narrow': (16, 48, 3, 1, 6, 17),
    'point': (64, 65, 1, 1, 3, 9),
    'odd': (5, 21, 3, 2, 9, 4),
}


def run(operator, inputs, output, **attributes):
    "The output of one ONNX operator."
    kind = onnx.helper.np_dtype_to_tensor_dtype
    names = [f'input{i}' for i in range(len(inputs))]
    given = {name: x for name, x in zip(names, inputs) if x is not None}
    node = onnx.helper.make_node(operator, [n if n in given else '' for n in names], ['out'], **attributes)
    values = [onnx.helper.make_tensor_value_info(n, kind(x.dtype), x.shape) for n, x in given.items()]
    graph = onnx.helper.make_graph([node], operator, values, [onnx.helper.make_tensor_value_info('out', kind(np.dtype(output)), None)])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid('', 17)], ir_version=9)
    return onnxruntime.InferenceSession(model.SerializeToString(), providers=['CPUExecutionProvider']).run(None, given)[0]


def half_away(v):
    return np.trunc(v + np.copysign(0.5, v))


def quantised(weight, bias, scale, zero):
    "Signed bytes with one unit for each output channel; the input's scales are folded in."
    scaled = weight * scale[None, :, None, None]
    unit = np.maximum(np.abs(scaled).max((1, 2, 3)) / np.float32(127), np.abs(bias) / np.float32(2**29))
    values = np.clip(half_away(scaled / unit[:, None, None, None]), -127, 127)
    zeros = (values.astype(np.float64) * zero.astype(np.float64)[None, :, None, None]).sum((1, 2, 3))
    start = half_away(bias.astype(np.float64) / unit.astype(np.float64) - zeros)
    return values.astype(np.int8), start.astype(np.int32), unit.astype(np.float32)


def convolution(random, case):
    inputs, outputs, kernel, stride, height, width = case
    weight = random.normal(0, 0.2, (outputs, inputs, kernel, kernel)).astype(np.float32)
    bias = random.normal(0, 1, outputs).astype(np.float32)
    scale = random.uniform(0.002, 0.05, inputs).astype(np.float32)
    zero = random.integers(0, 200, inputs).astype(np.float32)
    values, start, unit = quantised(weight, bias, scale, zero)
    x = random.integers(0, 256, (height, width, inputs)).astype(np.uint8)
    # The halo holds the bytes of zero.
    halo = kernel // 2
    padded = np.broadcast_to(zero.astype(np.uint8), (height + 2 * halo, width + 2 * halo, inputs)).copy()
    padded[halo:height + halo, halo:width + halo] = x
    planes = np.ascontiguousarray(padded.transpose(2, 0, 1)[None])
    sums = run('ConvInteger', [planes, values], np.int32, strides=[stride, stride])[0].transpose(1, 2, 0) + start
    real = (planes.astype(np.float32) - zero[None, :, None, None]) * scale[None, :, None, None]
    exact = run('Conv', [real, weight, bias], np.float32, strides=[stride, stride])[0].transpose(1, 2, 0)
    out_scale = (np.abs(exact).max((0, 1)) / 300).astype(np.float32)
    factor = unit / out_scale
    rectified = np.maximum(sums, 0).astype(np.float32) * factor
    return {
        'shape': np.array(case, np.int32), 'weight': weight, 'bias': bias, 'scale': scale, 'zero': zero, 'x': x,
        'values': values, 'start': start, 'unit': unit, 'factor': factor,
        'floats': sums.astype(np.float32) * unit, 'bytes': np.minimum(np.rint(rectified), 255).astype(np.uint8),
        'exact': exact.astype(np.float32),
    }


def upsampled(random):
    "Bytes at full size plus a tensor of half the size, as bytes of another scale."
    channels, height, width = 37, 6, 10
    x = random.integers(0, 256, (height, width, channels)).astype(np.uint8)
    deep = random.normal(0, 1, (3, 5, channels)).astype(np.float32)
    from_scale = random.uniform(0.005, 0.02, channels).astype(np.float32)
    to_scale = random.uniform(0.02, 0.04, channels).astype(np.float32)
    zero = random.integers(60, 140, channels).astype(np.float32)
    planes = np.ascontiguousarray(deep.transpose(2, 0, 1)[None])
    up = run('Resize', [planes, None, None, np.array([1, channels, height, width])], np.float32,
             mode='linear', coordinate_transformation_mode='half_pixel')[0].transpose(1, 2, 0)
    value = x * from_scale.astype(np.float64) + up
    out = np.clip(value / to_scale + zero, 0, 255)
    return {'x': x, 'deep': deep, 'from_scale': from_scale, 'to_scale': to_scale, 'zero': zero, 'sum': value.astype(np.float32),
            'out': out.astype(np.float32)}


def main():
    random = np.random.default_rng(14)
    golden = {f'{name}.{part}': v for name, case in CASES.items() for part, v in convolution(random, case).items()}
    golden |= {f'upsampled.{part}': v for part, v in upsampled(random).items()}
    save_file({k: np.ascontiguousarray(v) for k, v in golden.items()}, os.path.join(HERE, 'quantised.safetensors'))


if __name__ == '__main__':
    main()
