//! Groups of photos that show the same ground, which are not independent.

use std::collections::BTreeMap;

use grimnet_geo::distance_m;

use super::frame::Frame;

/// The photos by place, at least one in each: by the name of their place, in the order of the names, then those without a name by
/// the ground that they show.
///
/// A photo without a name belongs to the first group whose first photo has its centre nearer than the ground width of the narrower
/// of the two, so that they overlap or nearly so; if there is none, or its position or ground width is not known, it starts a group.
/// Groups are formed in the order of the photos. A chain of photos that overlap one by one is not a single place.
pub(super) fn places<'a>(frames: &[&'a Frame]) -> Vec<Vec<&'a Frame>> {
    let mut named: BTreeMap<&str, Vec<&Frame>> = BTreeMap::new();
    let mut unnamed: Vec<Vec<&Frame>> = Vec::new();
    for &frame in frames {
        if let Some(name) = &frame.place {
            named.entry(name).or_default().push(frame);
        } else if let Some(group) = unnamed
            .iter_mut()
            .find(|group| share_ground(group[0], frame))
        {
            group.push(frame);
        } else {
            unnamed.push(vec![frame]);
        }
    }
    named.into_values().chain(unnamed).collect()
}

/// A value of the photos of each place, of those that have one; without places that have none.
pub(super) fn by_place(
    places: &[Vec<&Frame>],
    value: impl Fn(&Frame) -> Option<f64>,
) -> Vec<Vec<f64>> {
    let groups = places
        .iter()
        .map(|place| place.iter().filter_map(|frame| value(frame)).collect());
    groups
        .filter(|group: &Vec<f64>| !group.is_empty())
        .collect()
}

/// Whether the centres of two photos are nearer than the ground width of the narrower one.
fn share_ground(one: &Frame, other: &Frame) -> bool {
    let ground = |frame: &Frame| frame.truth.zip(frame.shown_width_m);
    ground(one)
        .zip(ground(other))
        .is_some_and(|((one, one_width_m), (other, other_width_m))| {
            distance_m(one, other) < one_width_m.min(other_width_m)
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_geo::{LonLat, destination_en_m};

    fn photo(name: &str, east_m: f64, shown_width_m: f64) -> Frame {
        let origin = LonLat::new(120.72, 24.26);
        Frame {
            photo: name.to_owned(),
            truth: Some(destination_en_m(origin, east_m, 0.0)),
            shown_width_m: Some(shown_width_m),
            ..Frame::default()
        }
    }

    fn names(frames: &[Frame]) -> Vec<String> {
        let all: Vec<&Frame> = frames.iter().collect();
        let name = |group: Vec<&Frame>| group.iter().map(|f| f.photo.as_str()).collect();
        places(&all).into_iter().map(name).collect()
    }

    #[test]
    fn photos_without_a_place_are_grouped_by_ground() {
        // Sixty metres apart, each 157 m wide: the third is 120 m from the first, the fourth 180 m.
        let strip = ["a", "b", "c", "d", "e"]
            .iter()
            .zip(0..)
            .map(|(name, i)| photo(name, 60.0 * f64::from(i), 157.0));
        let strip: Vec<Frame> = strip.collect();
        assert_eq!(names(&strip), ["abc", "de"]);
        // The narrower photo decides.
        let narrow = [photo("a", 0.0, 157.0), photo("b", 60.0, 50.0)];
        assert_eq!(names(&narrow), ["a", "b"]);
    }

    #[test]
    fn names_count_where_there_are_some_and_unknown_ground_is_a_place_of_its_own() {
        let named = |frame: Frame, place: &str| Frame {
            place: Some(place.to_owned()),
            ..frame
        };
        let nowhere = |name: &str| Frame {
            truth: None,
            ..photo(name, 0.0, 157.0)
        };
        let frames = [
            nowhere("a"),
            photo("b", 0.0, 157.0),
            named(photo("c", 0.0, 157.0), "z"),
            named(photo("d", 9_000.0, 157.0), "z"),
            named(photo("e", 0.0, 157.0), "y"),
            nowhere("f"),
            photo("g", 1.0, 157.0),
        ];
        assert_eq!(names(&frames), ["e", "cd", "a", "bg", "f"]);
    }
}
