//! Matrix products against f64 (or exact integers) on random shapes, for every instruction set that the machine has.

mod reference;

use grimnet_kernels::{
    Isa, MatMut, MatRef, matmul_nn, matmul_nt, matmul_nt_i8, matmul_nt_i8_by_rows, matmul_nt_stored,
};
use half::f16;
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
            matmul_nt(isa, MatRef::new(&a, m, k), MatRef::new(&b, n, k), MatMut::new(&mut c, m, n));
            prop_assert!(expected.error(&c) < 2e-6, "{isa} nt: {:e}", expected.error(&c));
            c.fill(f32::NAN);
            matmul_nn(isa, MatRef::new(&a, m, k), MatRef::new(&b_rows, k, n), MatMut::new(&mut c, m, n));
            prop_assert!(expected.error(&c) < 2e-6, "{isa} nn: {:e}", expected.error(&c));
        }
    }

    /// The stored numbers are exact in single precision, so only the rounding of the sums differs.
    #[test]
    fn matmul_of_stored_numbers_equals_f64(m in 0usize..14, n in 0usize..150, k in 0usize..300, seed: u32) {
        let (a, b) = (random(m * k, seed.into()), random(n * k, u64::from(seed) + 1));
        let halves: Vec<f16> = b.iter().map(|&v| f16::from_f32(v)).collect();
        let bytes: Vec<i8> = b.iter().map(|&v| (v * 127.0) as i8).collect();
        for isa in Isa::available() {
            let mut c = vec![f32::NAN; m * n];
            let left = MatRef::new(&a, m, k);
            matmul_nt_stored(isa, left, MatRef::new(&halves, n, k), MatMut::new(&mut c, m, n));
            let widened: Vec<f32> = halves.iter().map(|&v| f32::from(v)).collect();
            let expected = reference::matmul_nt(m, n, k, &a, &widened);
            prop_assert!(expected.error(&c) < 2e-6, "{isa} f16: {:e}", expected.error(&c));
            c.fill(f32::NAN);
            matmul_nt_stored(isa, left, MatRef::new(&bytes, n, k), MatMut::new(&mut c, m, n));
            let widened: Vec<f32> = bytes.iter().map(|&v| f32::from(v)).collect();
            let expected = reference::matmul_nt(m, n, k, &a, &widened);
            prop_assert!(expected.error(&c) < 2e-6, "{isa} i8: {:e}", expected.error(&c));
        }
    }

    /// Sizes at which the work is cut into several blocks in every direction.
    #[test]
    fn large_matmul_equals_f64(m in 90usize..220, n in 120usize..400, k in 1usize..40, seed: u32) {
        let (a, b) = (random(m * k, seed.into()), random(n * k, u64::from(seed) + 1));
        let expected = reference::matmul_nt(m, n, k, &a, &b);
        for isa in Isa::available() {
            let mut c = vec![f32::NAN; m * n];
            matmul_nt(isa, MatRef::new(&a, m, k), MatRef::new(&b, n, k), MatMut::new(&mut c, m, n));
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
            matmul_nt_i8(isa, MatRef::new(&a, m, k), MatRef::new(&b, n, k), MatMut::new(&mut c, m, n));
            prop_assert_eq!(&c, &want, "{}", isa);
            c.fill(i32::MIN);
            let (a, b) = (MatRef::new(&a, m, k), MatRef::new(&b, n, k));
            let rows = std::sync::Mutex::new(vec![0; m]);
            matmul_nt_i8_by_rows(isa, a, b, &mut c, |first, sums| {
                assert_eq!(sums, &want[first * n..][..sums.len()], "{isa}");
                rows.lock().unwrap()[first..][..sums.len() / n].iter_mut().for_each(|times| *times += 1);
            });
            prop_assert_eq!(&c, &want, "{} by rows", isa);
            let times = usize::from(n > 0);
            prop_assert_eq!(rows.into_inner().unwrap(), vec![times; m], "each row is finished once");
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
        matmul_nt(
            isa,
            MatRef::new(&a, m, k),
            MatRef::new(&b, n, k),
            MatMut::new(&mut c, m, n),
        );
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
    matmul_nt_i8(
        Isa::Portable,
        MatRef::new(&a, m, k),
        MatRef::new(&b, n, k),
        MatMut::new(&mut want, m, n),
    );
    assert_eq!(
        want[n + 2],
        (0..k)
            .map(|l| i32::from(a[k + l]) * i32::from(b[2 * k + l]))
            .sum::<i32>()
    );
    for isa in Isa::available() {
        let mut c = vec![0; m * n];
        matmul_nt_i8(
            isa,
            MatRef::new(&a, m, k),
            MatRef::new(&b, n, k),
            MatMut::new(&mut c, m, n),
        );
        assert!(c == want, "{isa}");
        c.fill(0);
        let (a, b) = (MatRef::new(&a, m, k), MatRef::new(&b, n, k));
        matmul_nt_i8_by_rows(isa, a, b, &mut c, |_, _| {});
        assert!(c == want, "{isa} by rows");
    }
}

/// Rows that are not contiguous, on every path: few rows, packed columns, a last panel that is not full.
#[test]
fn row_strides_are_followed_and_gaps_left_alone() {
    let (n, k) = (37, 29);
    for m in [3, 50] {
        let (a, b) = (random(m * (k + 5), 1), random(n * (k + 2), 2));
        let compact = |from: &[f32], rows: usize, stride: usize| -> Vec<f32> {
            (0..rows)
                .flat_map(|r| from[r * stride..][..k].to_vec())
                .collect()
        };
        let (dense_a, dense_b) = (compact(&a, m, k + 5), compact(&b, n, k + 2));
        let expected = reference::matmul_nt(m, n, k, &dense_a, &dense_b);
        let mut b_rows = vec![9.0; k * (n + 4)];
        (0..n * k).for_each(|i| b_rows[i % k * (n + 4) + i / k] = dense_b[i]);
        let a = MatRef::with_row_stride(&a, m, k, k + 5);
        for isa in Isa::available() {
            for transposed in [true, false] {
                let mut c = vec![7.5; m * (n + 3)];
                let out = MatMut::with_row_stride(&mut c, m, n, n + 3);
                if transposed {
                    matmul_nt(isa, a, MatRef::with_row_stride(&b, n, k, k + 2), out);
                } else {
                    matmul_nn(isa, a, MatRef::with_row_stride(&b_rows, k, n, n + 4), out);
                }
                let rows: Vec<f32> = c.chunks(n + 3).flat_map(|row| row[..n].to_vec()).collect();
                assert!(expected.error(&rows) < 2e-6, "{isa} {m}");
                assert!(c.chunks(n + 3).all(|row| row[n..] == [7.5; 3]), "{isa} {m}");
            }
        }
    }
    let bytes: Vec<i8> = (0..200).map(|i| (i * 37 % 251) as i8).collect();
    let (a, b) = (
        MatRef::with_row_stride(&bytes, 5, 7, 11),
        MatRef::with_row_stride(&bytes[60..], 6, 7, 9),
    );
    for isa in Isa::available() {
        let mut c = vec![-1; 5 * 8];
        matmul_nt_i8(isa, a, b, MatMut::with_row_stride(&mut c, 5, 6, 8));
        for (i, row) in c.chunks(8).enumerate() {
            assert_eq!(row[6..], [-1, -1]);
            for (j, &value) in row[..6].iter().enumerate() {
                let products = a.row(i).iter().zip(b.row(j));
                let want: i32 = products.map(|(&a, &b)| i32::from(a) * i32::from(b)).sum();
                assert_eq!(value, want, "{isa}");
            }
        }
    }
}

#[test]
#[should_panic(expected = "shapes of a matrix product: 2x3 by 4x2 into 2x2")]
fn shapes_that_do_not_fit_panic() {
    let (a, b, mut c) = ([0.0; 6], [0.0; 8], [0.0; 4]);
    matmul_nt(
        Isa::Portable,
        MatRef::new(&a, 2, 3),
        MatRef::new(&b, 2, 4),
        MatMut::new(&mut c, 2, 2),
    );
}
