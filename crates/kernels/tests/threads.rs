//! A result is the same to the last bit on any number of threads, and steady work allocates nothing.
#![allow(clippy::unwrap_used)]

mod reference;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use grimnet_kernels::{
    Activation, Conv2d, ConvSpec, ConvTranspose2d, Isa, MatMut, MatRef, Tensor, Workspace,
    channel_moments, matmul_nn, matmul_nt, max_pool_2x2, scale_shift, train, upsample_bilinear_add,
};
use reference::random;

/// Counts the allocations of a kilobyte or more: rayon's own bookkeeping is smaller.
struct Counting;

static LARGE_ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: hands everything to the system allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if layout.size() >= 1024 {
            LARGE_ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        }
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn on_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap()
        .install(work)
}

/// One layer of each kind, large enough to be cut into pieces.
struct Layers {
    convs: Vec<Conv2d>,
    transposed: ConvTranspose2d,
    outputs: Vec<Tensor>,
    workspace: Workspace,
}

impl Layers {
    fn new(isa: Isa) -> Self {
        let specs = [
            (3, 48, 3, 2),
            (48, 40, 3, 1),
            (40, 130, 3, 1),
            (130, 130, 3, 1),
            (130, 65, 1, 1),
        ];
        let convs = specs.map(|(in_channels, out_channels, kernel, stride)| {
            let spec = ConvSpec {
                in_channels,
                out_channels,
                kernel,
                stride,
            };
            let bias = random(out_channels, 2);
            Conv2d::new(
                isa,
                spec,
                &random(spec.weight_len(), 1),
                &bias,
                Activation::Relu,
            )
            .unwrap()
        });
        let transposed = ConvTranspose2d::new(
            isa,
            65,
            33,
            &random(65 * 33 * 16, 3),
            &random(33, 4),
            Activation::Identity,
        );
        Self {
            convs: convs.into(),
            transposed: transposed.unwrap(),
            outputs: vec![Tensor::default(); 7],
            workspace: Workspace::new(),
        }
    }

    fn run(&mut self, isa: Isa, input: &Tensor) -> &Tensor {
        let mut input = input;
        for (conv, output) in self.convs.iter().zip(&mut self.outputs) {
            conv.forward(input, output, &mut self.workspace);
            input = output;
        }
        let [.., last, pooled, up] = self.outputs.as_mut_slice() else {
            unreachable!()
        };
        max_pool_2x2(isa, last, pooled);
        upsample_bilinear_add(isa, pooled, last);
        scale_shift(isa, last, &[0.5; 65], &[0.1; 65], Activation::Relu);
        self.transposed.forward(last, up, &mut self.workspace);
        up
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let input = Tensor::from_hwc(&random(150 * 130 * 3, 5), 150, 130, 3);
    let (a, b) = (random(150 * 70, 6), random(130 * 70, 7));
    let batch = train::BatchConvSpec {
        batch: 2,
        height: 40,
        width: 50,
        in_channels: 20,
        out_channels: 35,
    };
    let (x, y) = (random(2 * 20 * 40 * 50, 8), random(2 * 35 * 40 * 50, 9));
    for isa in Isa::available() {
        let all = |threads| {
            on_threads(threads, || {
                let output = Layers::new(isa).run(isa, &input).clone();
                let (mean, variance) = channel_moments(isa, &output, None);
                let mut results = vec![
                    output.to_chw(),
                    mean,
                    variance,
                    vec![0.0; 150 * 130],
                    vec![0.0; 70 * 70],
                ];
                matmul_nt(
                    isa,
                    MatRef::new(&a, 150, 70),
                    MatRef::new(&b, 130, 70),
                    MatMut::new(&mut results[3], 150, 130),
                );
                matmul_nn(
                    isa,
                    MatRef::new(&a[..70 * 130], 70, 130),
                    MatRef::new(&b, 130, 70),
                    MatMut::new(&mut results[4], 70, 70),
                );
                let mut grad_weight = vec![0.0; batch.weight_len()];
                train::conv3x3_grad_weight(isa, batch, &x, &y, &mut grad_weight);
                results.push(grad_weight);
                results
            })
        };
        let one = all(1);
        assert!(one.iter().flatten().all(|v| v.is_finite()));
        for threads in [2, 3, 7] {
            assert!(all(threads) == one, "{isa} on {threads} threads");
        }
    }
}

#[test]
fn steady_work_allocates_nothing() {
    let input = Tensor::from_hwc(&random(96 * 96 * 3, 5), 96, 96, 3);
    let isa = Isa::detect();
    let mut layers = Layers::new(isa);
    // The other test of this program allocates too, so look for one quiet run among many.
    let quiet = (0..1000).any(|_| {
        layers.run(isa, &input);
        let before = LARGE_ALLOCATIONS.load(Ordering::Relaxed);
        layers.run(isa, &input);
        LARGE_ALLOCATIONS.load(Ordering::Relaxed) == before
    });
    assert!(quiet);
}
