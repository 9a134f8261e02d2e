//! Matches of descriptors against OpenCV.

use super::*;

#[test]
fn matches_are_opencvs() {
    let golden = golden().matching;
    let mut matcher = Matcher::new(Isa::detect());
    let mut matches = Vec::new();
    let (query, tile) = (
        Descriptors::F32(&golden.query),
        Descriptors::F32(&golden.tile),
    );
    for (ratio, expected) in [(None, &golden.mutual), (Some(0.8), &golden.mutual_ratio)] {
        matcher
            .mutual(query, tile, golden.dim, ratio, &mut matches)
            .unwrap();
        let found: Vec<(u32, u32)> = matches
            .iter()
            .map(|found| (found.query, found.tile))
            .collect();
        assert_eq!(&found, expected);
    }
}

#[test]
fn quantised_matches_are_nearly_the_same() {
    let golden = golden().matching;
    let step = 1.0 / 127.0;
    let quantise = |rows: &[f32]| {
        rows.iter()
            .map(|value| (value / step).round() as i8)
            .collect::<Vec<_>>()
    };
    let (query, tile) = (quantise(&golden.query), quantise(&golden.tile));
    let mut matches = Vec::new();
    let side = |values| Descriptors::I8 {
        values,
        scale: step,
    };
    Matcher::new(Isa::detect())
        .mutual(
            side(&query),
            side(&tile),
            golden.dim,
            Some(0.8),
            &mut matches,
        )
        .unwrap();
    let kept = matches
        .iter()
        .filter(|found| golden.mutual_ratio.contains(&(found.query, found.tile)))
        .count();
    assert!(kept * 20 >= golden.mutual_ratio.len() * 19, "{kept}");
    for found in &matches {
        let (a, b) = (
            found.query as usize * golden.dim,
            found.tile as usize * golden.dim,
        );
        let exact: f32 = golden.query[a..][..golden.dim]
            .iter()
            .zip(&golden.tile[b..][..golden.dim])
            .map(|(x, y)| x * y)
            .sum();
        assert!((exact - found.similarity).abs() < 0.02);
    }
}

#[test]
fn guided_matches_are_mutual_among_the_allowed_pairs_and_nearly_the_best_of_all() {
    let golden = golden().matching;
    let dim = golden.dim;
    let (n, m) = (golden.query.len() / dim, golden.tile.len() / dim);
    let similarity = |i: usize, j: usize| -> f32 {
        let (a, b) = (
            &golden.query[i * dim..][..dim],
            &golden.tile[j * dim..][..dim],
        );
        a.iter().zip(b).map(|(x, y)| x * y).sum()
    };
    let is_near = |i: usize, j: usize| (i * 7 + j * 5) % 11 < 2;
    let closer = |i: usize, j: usize| {
        let all = (0..m).map(|other| similarity(i, other));
        all.filter(|&other| other > similarity(i, j) + 1e-6).count()
    };
    for max_closer in [0, 1, 5, usize::MAX] {
        let mut expected = Vec::new();
        for i in 0..n {
            let best = (0..m)
                .filter(|&j| is_near(i, j))
                .max_by(|&a, &b| similarity(i, a).total_cmp(&similarity(i, b)));
            let Some(j) = best else { continue };
            let rival = (0..n)
                .filter(|&other| is_near(other, j))
                .max_by(|&a, &b| similarity(a, j).total_cmp(&similarity(b, j)));
            if rival == Some(i) && closer(i, j) <= max_closer {
                expected.push((i as u32, j as u32));
            }
        }
        let mut matcher = Matcher::new(Isa::detect());
        let mut compared = matcher
            .compare(
                Descriptors::F32(&golden.query),
                Descriptors::F32(&golden.tile),
                dim,
            )
            .unwrap();
        let mut matches = Vec::new();
        compared.guided(
            |i, near| near.extend((0..m).filter(|&j| is_near(i, j))),
            max_closer,
            &mut matches,
        );
        let found: Vec<(u32, u32)> = matches.iter().map(|m| (m.query, m.tile)).collect();
        assert!(max_closer == 0 || !expected.is_empty());
        assert_eq!(found, expected, "at most {max_closer} closer");
    }
}

#[test]
fn matching_refuses_what_it_cannot_compare() {
    let mut matcher = Matcher::new(Isa::detect());
    let mut matches = Vec::new();
    let floats = [0.0; 32];
    let bytes = Descriptors::I8 {
        values: &[0; 32],
        scale: 1.0,
    };
    assert!(
        matcher
            .mutual(Descriptors::F32(&floats), bytes, 16, None, &mut matches)
            .is_err()
    );
    assert!(
        matcher
            .mutual(
                Descriptors::F32(&floats),
                Descriptors::F32(&floats),
                15,
                None,
                &mut matches
            )
            .is_err()
    );
    assert!(
        matcher
            .mutual(
                Descriptors::F32(&floats),
                Descriptors::F32(&floats),
                0,
                None,
                &mut matches
            )
            .is_err()
    );
    assert!(
        matcher
            .mutual(
                Descriptors::F32(&[]),
                Descriptors::F32(&floats),
                16,
                None,
                &mut matches
            )
            .is_ok()
    );
    assert!(matches.is_empty());
    // Equal rows: the first of each wins, none is used twice.
    matcher
        .mutual(
            Descriptors::F32(&floats),
            Descriptors::F32(&floats),
            16,
            None,
            &mut matches,
        )
        .unwrap();
    assert_eq!(
        matches
            .iter()
            .map(|found| (found.query, found.tile))
            .collect::<Vec<_>>(),
        [(0, 0)]
    );
}

#[test]
fn pairs_for_which_there_is_no_memory_are_refused() {
    // A pebibyte of similarities.
    let rows = 1 << 24;
    let values = vec![0_i8; rows];
    let many = Descriptors::I8 {
        values: &values,
        scale: 1.0,
    };
    let refused = Matcher::new(Isa::detect()).mutual(many, many, 1, None, &mut Vec::new());
    let expected = grimnet_locate::MatchingError::Memory {
        rows,
        columns: rows,
    };
    assert_eq!(refused, Err(expected));
}
