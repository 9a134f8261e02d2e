//! Statistics of a sample: percentiles, bootstrap intervals and the interval of a share.

pub use grimnet_track::measure::percentile;
use rand::{Rng, SeedableRng};

/// Quantile of the normal distribution for a two-sided 95 % interval.
const Z_95: f64 = 1.959_964;

/// Share of values at most `limit`; 0 for an empty sample.
#[must_use]
pub fn share_within(values: &[f64], limit: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.iter().filter(|v| **v <= limit).count() as f64 / values.len() as f64
}

/// Mean; `None` for an empty sample.
#[must_use]
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// 95 % percentile bootstrap interval (Efron 1979) of a figure, 1,000 resamples, fixed seed. The values are in groups that are not
/// independent within a group, such as photos of one place: whole groups are drawn (cluster bootstrap, Davison & Hinkley 1997,
/// section 3.8). An end is infinite if the figure is infinite in more than 2.5 % of the resamples.
#[must_use]
pub fn grouped_bootstrap_interval<T: Copy>(
    groups: &[Vec<T>],
    figure: impl Fn(&[T]) -> f64,
) -> [f64; 2] {
    if groups.is_empty() {
        return [0.0, 0.0];
    }
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1979);
    let mut sample = Vec::new();
    let figures: Vec<f64> = (0..1000)
        .map(|_| {
            sample.clear();
            for _ in groups {
                sample.extend_from_slice(&groups[rng.random_range(0..groups.len())]);
            }
            figure(&sample)
        })
        .collect();
    [0.025, 0.975].map(|q| percentile(&figures, q).unwrap_or(f64::INFINITY))
}

/// 95 % score interval of a share of `count` values (Wilson 1927); the whole range for an empty sample.
#[must_use]
pub fn wilson_interval(share: f64, count: usize) -> [f64; 2] {
    if count == 0 {
        return [0.0, 1.0];
    }
    let (n, z2) = (count as f64, Z_95 * Z_95);
    let centre = (share + z2 / (2.0 * n)) / (1.0 + z2 / n);
    let reach = Z_95 / (1.0 + z2 / n) * (share * (1.0 - share) / n + z2 / (4.0 * n * n)).sqrt();
    [(centre - reach).max(0.0), (centre + reach).min(1.0)]
}

/// 95 % interval of a share, the mean of values from 0 to 1 in groups: what [`grouped_bootstrap_interval`] and [`wilson_interval`] on the
/// number of groups span together. Few groups are drawn alike, most so where nearly all agree: the bootstrap alone is then too narrow, and
/// narrower for a share below 1 than for one of 1.
#[must_use]
pub fn grouped_share_interval(groups: &[Vec<f64>]) -> [f64; 2] {
    let share = |sample: &[f64]| mean(sample).unwrap_or(0.0);
    let [low, high] = wilson_interval(share(&groups.concat()), groups.len());
    let [low_drawn, high_drawn] = grouped_bootstrap_interval(groups, share);
    [low.min(low_drawn), high.max(high_drawn)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn an_interval_by_group_is_wider_where_a_group_agrees_with_itself() {
        let share = |sample: &[f64]| mean(sample).unwrap_or(0.0);
        // Ten places of twenty photos each, either all right or all wrong.
        let groups: Vec<Vec<f64>> = (0..10)
            .map(|place| vec![f64::from(u8::from(place < 7)); 20])
            .collect();
        let alone: Vec<Vec<f64>> = groups
            .concat()
            .into_iter()
            .map(|value| vec![value])
            .collect();
        let by_photo = grouped_bootstrap_interval(&alone, share);
        let by_place = grouped_bootstrap_interval(&groups, share);
        let width = |[low, high]: [f64; 2]| high - low;
        assert!(
            width(by_place) > 3.0 * width(by_photo),
            "{by_place:?} {by_photo:?}"
        );
        assert!(by_place[0] < 0.7 && 0.7 < by_place[1]);
        assert_eq!(grouped_bootstrap_interval::<f64>(&[], share), [0.0, 0.0]);
    }

    #[test]
    fn intervals_are_wilsons() {
        // statsmodels.stats.proportion.proportion_confint(7, 10, method="wilson")
        let [low, high] = wilson_interval(0.7, 10);
        assert_relative_eq!(low, 0.396_778_15, epsilon = 1e-6);
        assert_relative_eq!(high, 0.892_208_73, epsilon = 1e-6);
        assert_eq!(wilson_interval(0.0, 0), [0.0, 1.0]);
        assert_relative_eq!(wilson_interval(0.0, 1000)[1], 0.003_826_8, epsilon = 1e-5);
    }

    #[test]
    fn groups_that_agree_have_an_interval_as_wide_as_their_number_gives() {
        let all_right = vec![vec![1.0; 10], vec![1.0; 3], vec![1.0]];
        assert_eq!(grouped_share_interval(&all_right), wilson_interval(1.0, 3));
        let one_place = [vec![1.0, 0.0]];
        assert_eq!(grouped_share_interval(&one_place), wilson_interval(0.5, 1));
        assert_eq!(grouped_share_interval(&[]), [0.0, 1.0]);
    }

    #[test]
    fn a_miss_makes_no_interval_narrower() {
        let mut five = vec![vec![1.0; 6]; 5];
        let [all, _] = grouped_share_interval(&five);
        five[0][0] = 0.0;
        let [one_missing, _] = grouped_share_interval(&five);
        assert!(one_missing < all, "{one_missing} {all}");
        // Where groups differ the draws say more than their number does.
        let split = vec![vec![1.0; 30], vec![0.0; 2], vec![0.0; 2], vec![0.0; 2]];
        assert_eq!(grouped_share_interval(&split)[0], 0.0);
        assert!(wilson_interval(30.0 / 36.0, 4)[0] > 0.3);
    }
}
