//! Which frames of a video are taken.

/// The samples to take at a rate, in the order in which they are shown: for each tick of the rate, counted from the first frame
/// shown, the nearest frame. No frame comes twice.
pub(crate) fn at_rate(shown_s: &[Option<f64>], frames_per_s: f64) -> Vec<usize> {
    let mut shown: Vec<(usize, f64)> = shown_s
        .iter()
        .enumerate()
        .filter_map(|(sample, time_s)| Some((sample, (*time_s)?)))
        .collect();
    shown.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    let first_s = shown.first().map_or(0.0, |first| first.1);
    // The tick of the last frame taken, and how far it is from it.
    let mut last: Option<(f64, f64)> = None;
    let mut taken: Vec<usize> = Vec::new();
    for (sample, time_s) in shown {
        let ticks = (time_s - first_s) * frames_per_s;
        let tick = ticks.round();
        let distance = (ticks - tick).abs();
        match last {
            Some((last_tick, last_distance)) if last_tick == tick => {
                if distance < last_distance {
                    taken.pop();
                    taken.push(sample);
                    last = Some((tick, distance));
                }
            }
            _ => {
                taken.push(sample);
                last = Some((tick, distance));
            }
        }
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_frame_of_each_tick() {
        let at_30: Vec<Option<f64>> = (0..61).map(|n| Some(f64::from(n) / 30.0)).collect();
        assert_eq!(at_rate(&at_30, 2.0), [0, 15, 30, 45, 60]);
        assert_eq!(at_rate(&at_30, 1000.0).len(), 61);
        assert_eq!(at_rate(&at_30, 0.2), [0]);
        assert_eq!(at_rate(&at_30, 0.5), [0, 60]);
        assert_eq!(at_rate(&[], 2.0), [0; 0]);
    }

    #[test]
    fn order_of_showing_gaps_and_samples_that_are_not_shown() {
        let times = [Some(1.0), Some(1.6), Some(1.2), None, Some(9.0)];
        assert_eq!(at_rate(&times, 5.0), [0, 2, 1, 4]);
        assert_eq!(at_rate(&times, 1.0), [0, 1, 4]);
    }
}
