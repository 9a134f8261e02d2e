//! Pixels that are not square, as anamorphic and standard-definition videos have them.

use image::{Rgb, RgbImage};

use crate::error::Fault;

/// `aspect_ratio_idc` from 1 on (ITU-T H.264, table E-1; H.265, table E.1).
const BY_NUMBER: [(u32, u32); 16] = [
    (1, 1),
    (12, 11),
    (10, 11),
    (16, 11),
    (40, 33),
    (24, 11),
    (20, 11),
    (32, 11),
    (80, 33),
    (18, 11),
    (15, 11),
    (64, 33),
    (160, 99),
    (4, 3),
    (3, 2),
    (2, 1),
];
/// No lens stretches by so much; the longest pixels of the standards' tables are 32:11.
const LARGEST: u32 = 4;

/// Width of a pixel in proportion to its height.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PixelAspect {
    pub width: u32,
    pub height: u32,
}

impl PixelAspect {
    /// `None` if one of the numbers is 0, which stands for no statement.
    pub(crate) fn new(width: u32, height: u32) -> Option<Self> {
        (width > 0 && height > 0).then_some(Self { width, height })
    }

    pub(crate) fn is_square(self) -> bool {
        self.width == self.height
    }

    /// From `aspect_ratio_idc`.
    pub(crate) fn of_number(number: u32) -> Option<Self> {
        let place = usize::try_from(number).ok()?.checked_sub(1)?;
        let (width, height) = BY_NUMBER.get(place)?;
        Self::new(*width, *height)
    }

    /// Returns an error if it cannot be right.
    pub(crate) fn check(self) -> Result<(), Fault> {
        let Self { width, height } = self;
        if width.max(height) / width.min(height) < LARGEST {
            return Ok(());
        }
        Err(Fault::damaged(format!(
            "it says that its pixels are {width}:{height}, and expected is at most {LARGEST} times as wide as high or as high as wide"
        )))
    }

    /// Factors of a picture's width and height that make its pixels square: one of them is 1, the other above.
    pub(crate) fn stretch(self) -> (f64, f64) {
        let wide = f64::from(self.width) / f64::from(self.height);
        (wide.max(1.0), wide.recip().max(1.0))
    }

    /// The picture with square pixels, linearly between those that there are.
    pub(crate) fn squared(self, picture: &RgbImage) -> RgbImage {
        let (width, height) = picture.dimensions();
        let stretch = self.stretch();
        let columns = neighbours(width, stretch.0);
        let rows = neighbours(height, stretch.1);
        RgbImage::from_fn(columns.len() as u32, rows.len() as u32, |x, y| {
            let (left, right, of_right) = columns[x as usize];
            let (above, below, of_below) = rows[y as usize];
            let [a, b] = [left, right].map(|x| picture.get_pixel(x, above).0);
            let [c, d] = [left, right].map(|x| picture.get_pixel(x, below).0);
            Rgb(std::array::from_fn(|i| {
                let upper = mixed(a[i].into(), b[i].into(), of_right);
                let lower = mixed(c[i].into(), d[i].into(), of_right);
                mixed(upper, lower, of_below).round() as u8
            }))
        })
    }
}

fn mixed(first: f32, second: f32, of_second: f32) -> f32 {
    first + of_second * (second - first)
}

/// For each pixel of a stretched side: the pixels before and after its centre, and the share of the latter.
fn neighbours(side_px: u32, stretch: f64) -> Vec<(u32, u32, f32)> {
    let to = (f64::from(side_px) * stretch).round();
    let last = side_px.saturating_sub(1);
    (0..to as u32)
        .map(|at| {
            let from = (f64::from(at) + 0.5) * f64::from(side_px) / to - 0.5;
            let from = from.clamp(0.0, f64::from(last));
            let before = from as u32;
            let share = from - f64::from(before);
            (before, (before + 1).min(last), share as f32)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp() {
        let ramp = RgbImage::from_fn(60, 6, |x, _| Rgb([4 * x as u8, 0, 255]));
        let wide = PixelAspect::new(4, 3).unwrap().squared(&ramp);
        assert_eq!(wide.dimensions(), (80, 6));
        for x in 1..79 {
            // Centres: (x + 0.5) 3/4 - 0.5 pixels of the ramp.
            let expected = (4.0 * ((f64::from(x) + 0.5) * 0.75 - 0.5)).round();
            assert_eq!(f64::from(wide.get_pixel(x, 3).0[0]), expected, "{x}");
        }
        let tall = PixelAspect::new(1, 2).unwrap().squared(&ramp);
        assert_eq!(tall.dimensions(), (60, 12));
        assert_eq!(tall.get_pixel(7, 11), ramp.get_pixel(7, 5));
    }

    #[test]
    fn aspects_are_those_of_the_standards() {
        for (number, expected) in [
            (0, None),
            (1, Some((1, 1))),
            (2, Some((12, 11))),
            (14, Some((4, 3))),
            (16, Some((2, 1))),
            (17, None),
            (255, None),
        ] {
            let found = PixelAspect::of_number(number).map(|one| (one.width, one.height));
            assert_eq!(found, expected, "{number}");
        }
        for (width, height) in BY_NUMBER {
            PixelAspect::new(width, height).unwrap().check().unwrap();
        }
        assert_eq!(PixelAspect::new(0, 3), None);
        assert_eq!(PixelAspect::new(3, 0), None);
        for (width, height) in [(4, 1), (1, 65_535)] {
            let fault = PixelAspect::new(width, height)
                .unwrap()
                .check()
                .unwrap_err();
            assert!(
                fault.to_string().contains(&format!("{width}:{height}")),
                "{fault}"
            );
        }
    }
}
