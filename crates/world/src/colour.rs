//! Linear colours. Display values are the square root of linear ones (gamma 2), which is close to
//! sRGB and costs one instruction.

use std::ops::{Add, AddAssign, Mul};

/// Linear red, green, blue; 1 is white in full sun.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Rgb(pub(crate) [f32; 3]);

/// A linear colour from display values 0-255, as read off a photo.
pub(crate) const fn rgb8(r: u8, g: u8, b: u8) -> Rgb {
    let (r, g, b) = (r as f32 / 255.0, g as f32 / 255.0, b as f32 / 255.0);
    Rgb([r * r, g * g, b * b])
}

impl Rgb {
    #[inline]
    pub(crate) fn mix(self, other: Self, amount: f32) -> Self {
        let a = amount;
        Self([
            self.0[0] + (other.0[0] - self.0[0]) * a,
            self.0[1] + (other.0[1] - self.0[1]) * a,
            self.0[2] + (other.0[2] - self.0[2]) * a,
        ])
    }

    #[inline]
    pub(crate) fn times(self, other: Self) -> Self {
        Self([
            self.0[0] * other.0[0],
            self.0[1] * other.0[1],
            self.0[2] * other.0[2],
        ])
    }

    #[inline]
    pub(crate) fn luminance(self) -> f32 {
        0.3 * self.0[0] + 0.59 * self.0[1] + 0.11 * self.0[2]
    }
}

/// The colour made brighter or darker by a factor on its display value; positive for every factor.
#[inline]
pub(crate) fn toned(colour: Rgb, tone: f32) -> Rgb {
    let t = tone.max(0.2);
    colour * (t * t)
}

impl Mul<f32> for Rgb {
    type Output = Self;
    #[inline]
    fn mul(self, k: f32) -> Self {
        Self([self.0[0] * k, self.0[1] * k, self.0[2] * k])
    }
}

impl Add for Rgb {
    type Output = Self;
    #[inline]
    fn add(self, o: Self) -> Self {
        Self([self.0[0] + o.0[0], self.0[1] + o.0[1], self.0[2] + o.0[2]])
    }
}

impl AddAssign for Rgb {
    #[inline]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
