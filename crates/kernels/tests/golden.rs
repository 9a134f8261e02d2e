//! Convolutions of bytes against ONNX Runtime (`golden/make_golden.py`), on every instruction set that the machine has.

#![allow(clippy::unwrap_used)]

use grimnet_kernels::{
    ByteScale, ByteTensor, ConvSpec, Isa, QuantisedConv2d, QuantisedWeights, Tensor, UpsampledSum,
};
use safetensors::SafeTensors;

const GOLDEN: &[u8] = include_bytes!("golden/quantised.safetensors");

fn bytes(name: &str) -> Vec<u8> {
    let file = SafeTensors::deserialize(GOLDEN).unwrap();
    file.tensor(name).unwrap().data().to_vec()
}

fn words(name: &str) -> Vec<[u8; 4]> {
    bytes(name).as_chunks::<4>().0.to_vec()
}

fn floats(name: &str) -> Vec<f32> {
    words(name).into_iter().map(f32::from_le_bytes).collect()
}

fn integers(name: &str) -> Vec<i32> {
    words(name).into_iter().map(i32::from_le_bytes).collect()
}

#[test]
fn convolutions_of_bytes_are_those_of_onnx_runtime() {
    for name in ["wide", "deep", "narrow", "point", "odd"] {
        let of = |part: &str| format!("{name}.{part}");
        let shape = integers(&of("shape"));
        let [in_channels, out_channels, kernel, stride, height, width] = shape[..] else {
            panic!("{shape:?}");
        };
        let spec = ConvSpec {
            in_channels: in_channels as usize,
            out_channels: out_channels as usize,
            kernel: kernel as usize,
            stride: stride as usize,
        };
        let input = ByteScale {
            scale: floats(&of("scale")),
            zero: floats(&of("zero")),
        };
        let weights =
            QuantisedWeights::new(spec, &floats(&of("weight")), &floats(&of("bias")), &input)
                .unwrap();
        let signed: Vec<u8> = weights.values.iter().map(|v| v.cast_unsigned()).collect();
        assert!(signed == bytes(&of("values")), "{name}: weights");
        assert_eq!(weights.start, integers(&of("start")), "{name}");
        assert_eq!(weights.unit, floats(&of("unit")), "{name}");
        let x = ByteTensor::from_hwc(
            &bytes(&of("x")),
            height as usize,
            width as usize,
            &input.zero_bytes(),
        );
        for isa in Isa::available() {
            let conv = QuantisedConv2d::new(isa, spec, &weights, &floats(&of("factor"))).unwrap();
            let mut rectified = ByteTensor::default();
            conv.forward_relu(&x, &mut rectified);
            assert!(rectified.to_hwc() == bytes(&of("bytes")), "{isa} {name}");
            let conv = QuantisedConv2d::new(isa, spec, &weights, &weights.unit).unwrap();
            let mut output = Tensor::default();
            conv.forward(&x, &mut output);
            let output = output.to_hwc();
            assert!(output == floats(&of("floats")), "{isa} {name}");
            // What the rounding of the weights costs.
            let exact = floats(&of("exact"));
            let power = |values: &mut dyn Iterator<Item = f32>| values.map(|v| v * v).sum::<f32>();
            let error = power(&mut output.iter().zip(&exact).map(|(a, b)| a - b));
            let share = (error / power(&mut exact.iter().copied())).sqrt();
            assert!(share < 0.02, "{isa} {name}: {share}");
        }
    }
}

#[test]
fn sums_with_upsampled_tensors_are_those_of_onnx_runtime() {
    let (from, to) = (
        floats("upsampled.from_scale"),
        ByteScale {
            scale: floats("upsampled.to_scale"),
            zero: floats("upsampled.zero"),
        },
    );
    let channels = from.len();
    let input = ByteScale {
        zero: vec![0.0; channels],
        scale: from,
    };
    let x = ByteTensor::from_hwc(&bytes("upsampled.x"), 6, 10, &vec![0; channels]);
    let deep = Tensor::from_hwc(&floats("upsampled.deep"), 3, 5, channels);
    let sum = UpsampledSum::new(&input, &to);
    let mut outputs = Vec::new();
    for isa in Isa::available() {
        let mut output = ByteTensor::default();
        sum.run(isa, &x, &deep, &mut output);
        for (byte, expected) in output.to_hwc().iter().zip(floats("upsampled.out")) {
            assert!(
                (f32::from(*byte) - expected).abs() < 0.501,
                "{isa}: {byte} {expected}"
            );
        }
        outputs.push(output.to_hwc());
    }
    assert!(outputs.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn exact_upsampling_adds_what_ordinary_upsampling_adds() {
    let deep = Tensor::from_hwc(&floats("upsampled.deep"), 3, 5, 37);
    let sum = |isa: Isa, add: fn(Isa, &Tensor, &mut Tensor)| {
        let mut to = Tensor::new(6, 10, 37);
        to.fill(0.25);
        add(isa, &deep, &mut to);
        to.to_hwc()
    };
    let first = sum(Isa::Portable, grimnet_kernels::upsample_add_exact);
    for isa in Isa::available() {
        assert!(
            first == sum(isa, grimnet_kernels::upsample_add_exact),
            "{isa}"
        );
        let other = sum(isa, grimnet_kernels::upsample_bilinear_add);
        assert!(first.iter().zip(&other).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}
