"""Times the whole network in OpenVINO, ONNX Runtime and PyTorch, f32, on the CPU.

Usage: network.py MODEL.onnx|MODEL.xml [--threads 2 1] [--seconds 3]     (a file that export_onnx.py or quantise.py wrote)
Prints the median and the best of single runs after a warm-up, in milliseconds. Run it beside
`cargo run --release -p grimnet-net --example time_network`, with nothing else on the machine, and compare ratios only.
"""
import argparse
import statistics
import time
import numpy as np


def onnx_runtime(path, threads):
    import onnxruntime
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    session = onnxruntime.InferenceSession(path, options, providers=['CPUExecutionProvider'])
    shape = session.get_inputs()[0].shape
    return shape, lambda x: session.run(None, {'image': x})


def openvino(path, threads):
    import openvino
    settings = {'INFERENCE_NUM_THREADS': threads, 'PERFORMANCE_HINT': 'LATENCY', 'INFERENCE_PRECISION_HINT': 'f32'}
    model = openvino.Core().compile_model(path, 'CPU', settings)
    request = model.create_infer_request()
    return list(model.input(0).shape), lambda x: request.infer({0: x})


def measure(run, x, seconds):
    for _ in range(3):
        run(x)
    times, end = [], time.perf_counter() + seconds
    while time.perf_counter() < end or len(times) < 5:
        start = time.perf_counter()
        run(x)
        times.append((time.perf_counter() - start) * 1e3)
    return statistics.median(times), min(times)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('model')
    parser.add_argument('--threads', type=int, nargs='+', default=[2, 1])
    parser.add_argument('--seconds', type=float, default=3.0)
    arguments = parser.parse_args()
    for threads in arguments.threads:
        # Only OpenVINO reads its own files.
        for engine in (openvino,) if arguments.model.endswith('.xml') else (openvino, onnx_runtime):
            shape, run = engine(arguments.model, threads)
            x = np.random.default_rng(0).normal(size=shape).astype(np.float32)
            median, best = measure(run, x, arguments.seconds)
            print(f'{engine.__name__} {arguments.model} threads {threads}: median {median:.2f} ms, best {best:.2f} ms')


if __name__ == '__main__':
    main()
