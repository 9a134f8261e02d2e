//! On which side of the antimeridian the parts of a map are taken.

/// Coordinates that repeat around the world, from the western edge of a map on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AroundTheWorld {
    west: f64,
    period: f64,
}

impl AroundTheWorld {
    /// For a map of parts with these western and eastern edges, in coordinates that repeat after `period`: it begins after the widest
    /// part of the world that has none.
    pub fn from_edges(edges: impl IntoIterator<Item = (f64, f64)>, period: f64) -> Self {
        let mut edges: Vec<(f64, f64)> = edges.into_iter().collect();
        let west = edges.iter().map(|e| e.0).fold(f64::INFINITY, f64::min);
        let mut around = Self { west, period };
        for (from, to) in &mut edges {
            let shift = around.shift(*from);
            (*from, *to) = (*from + shift, *to + shift);
        }
        edges.sort_by(|a, b| a.0.total_cmp(&b.0));
        let end = edges.iter().map(|e| e.1).fold(f64::NEG_INFINITY, f64::max);
        let (mut widest, mut reached) = (west + period - end, west);
        for (from, to) in edges {
            if from - reached > widest {
                widest = from - reached;
                around.west = from;
            }
            reached = reached.max(to);
        }
        around
    }

    /// What a part with this western edge is moved by, whole periods.
    pub fn shift(&self, from: f64) -> f64 {
        -((from - self.west) / self.period).floor() * self.period
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn placed(edges: &[(f64, f64)]) -> Vec<f64> {
        let around = AroundTheWorld::from_edges(edges.iter().copied(), 360.0);
        edges.iter().map(|e| e.0 + around.shift(e.0)).collect()
    }

    #[test]
    fn a_map_begins_after_the_widest_gap() {
        // On one side of the antimeridian, nothing is moved.
        assert_eq!(placed(&[(8.0, 9.0), (-3.0, 8.0)]), [8.0, -3.0]);
        assert_eq!(placed(&[(185.0, 186.0)]), [185.0]);
        // All of the world.
        assert_eq!(placed(&[(-180.0, 0.0), (0.0, 180.0)]), [-180.0, 0.0]);
        // On both sides.
        assert_eq!(placed(&[(179.0, 180.0), (-180.0, -179.0)]), [179.0, 180.0]);
        assert_eq!(placed(&[(-180.0, -179.0), (179.0, 180.0)]), [180.0, 179.0]);
        // One of them crosses it, and one is counted from 0 to 360.
        assert_eq!(
            placed(&[(179.0, 181.0), (-179.0, -178.0), (182.0, 183.0)]),
            [179.0, 181.0, 182.0]
        );
        // A small part within a large one.
        assert_eq!(
            placed(&[(-170.0, -160.0), (100.0, 178.0), (110.0, 111.0)]),
            [190.0, 100.0, 110.0]
        );
    }
}
