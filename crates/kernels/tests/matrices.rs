//! Matrix products against f64 (or exact integers) on random shapes, for every instruction set that the machine has.

mod reference;

use grimnet_kernels::{Isa, matmul_nn, matmul_nt, matmul_nt_i8};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use reference::random;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn matmul_equals_f64(m in 0usize..70, n in 0usize..70, k in 0usize..300, seed: u32) {
        let (a, b) = (random(m * k, seed.into()), random(n * k, u64::from(seed) + 1));
        let mut b_rows = vec![0.0; n * k];
        (0..n * k).for_each(|i| b_rows[i % k * n + i / k] = b[i]);
        let expected = reference::matmul_nt(m, n, k, &a, &b);
        for isa in Isa::available() {
            let mut c = vec![f32::NAN; m * n];
            matmul_nt(isa, m, n, k, &a, &b, &mut c);
            prop_assert!(expected.error(&c) < 2e-6, "{isa} nt: {:e}", expected.error(&c));
            c.fill(f32::NAN);
            matmul_nn(isa, m, n, k, &a, &b_rows, &mut c);
            prop_assert!(expected.error(&c) < 2e-6, "{isa} nn: {:e}", expected.error(&c));
        }
    }

    /// Sizes at which the work is cut into several blocks in every direction.
    #[test]
    fn large_matmul_equals_f64(m in 90usize..220, n in 120usize..400, k in 1usize..40, seed: u32) {
        let (a, b) = (random(m * k, seed.into()), random(n * k, u64::from(seed) + 1));
        let expected = reference::matmul_nt(m, n, k, &a, &b);
        for isa in Isa::available() {
            let mut c = vec![f32::NAN; m * n];
            matmul_nt(isa, m, n, k, &a, &b, &mut c);
            prop_assert!(expected.error(&c) < 2e-6, "{isa} nt: {:e}", expected.error(&c));
        }
    }

    #[test]
    fn matmul_of_bytes_is_exact(m in 0usize..40, n in 0usize..70, k in 0usize..300, extreme: bool, seed: u64) {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut bytes = |len: usize| -> Vec<i8> {
            (0..len).map(|_| if extreme { -128 } else { rng.random() }).collect()
        };
        let (a, b) = (bytes(m * k), bytes(n * k));
        let want: Vec<i32> = (0..m * n)
            .map(|out| (0..k).map(|l| i32::from(a[out / n * k + l]) * i32::from(b[out % n * k + l])).sum())
            .collect();
        for isa in Isa::available() {
            let mut c = vec![i32::MIN; m * n];
            matmul_nt_i8(isa, m, n, k, &a, &b, &mut c);
            prop_assert_eq!(&c, &want, "{}", isa);
        }
    }
}

/// The right matrix is packed in chunks of four megabytes.
#[test]
fn matmul_deeper_and_wider_than_a_chunk_equals_f64() {
    let (m, n, k) = (14, 90, 40_000);
    let (a, b) = (random(m * k, 1), random(n * k, 2));
    let expected = reference::matmul_nt(m, n, k, &a, &b);
    for isa in Isa::available() {
        let mut c = vec![f32::NAN; m * n];
        matmul_nt(isa, m, n, k, &a, &b, &mut c);
        assert!(expected.error(&c) < 1e-5, "{isa}: {:e}", expected.error(&c));
    }
}

#[test]
fn matmul_of_many_bytes_is_exact() {
    let (m, n, k) = (200, 300, 130);
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let a: Vec<i8> = (0..m * k).map(|_| rng.random()).collect();
    let b: Vec<i8> = (0..n * k).map(|_| rng.random()).collect();
    let mut want = vec![0; m * n];
    matmul_nt_i8(Isa::Portable, m, n, k, &a, &b, &mut want);
    assert_eq!(
        want[n + 2],
        (0..k)
            .map(|l| i32::from(a[k + l]) * i32::from(b[2 * k + l]))
            .sum::<i32>()
    );
    for isa in Isa::available() {
        let mut c = vec![0; m * n];
        matmul_nt_i8(isa, m, n, k, &a, &b, &mut c);
        assert!(c == want, "{isa}");
    }
}
