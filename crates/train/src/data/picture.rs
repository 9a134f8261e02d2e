//! A picture and its resolution pyramid.

use image::RgbImage;

/// A picture with its resolution pyramid.
#[derive(Debug)]
pub struct Picture {
    levels: Vec<RgbImage>,
    /// Known keypoints of each level; levels beyond the last entry use the last entry.
    keypoints: Vec<Vec<[f32; 2]>>,
}

impl Picture {
    /// Builds the pyramid, down to sides of 64 pixels.
    pub fn new(image: RgbImage) -> Self {
        let mut levels = vec![image];
        while let Some(last) = levels.last() {
            if last.width().min(last.height()) < 128 {
                break;
            }
            let half = halved(last);
            levels.push(half);
        }
        Self {
            levels,
            keypoints: Vec::new(),
        }
    }

    /// Sets the known keypoints, the strongest first, in pixels of the whole picture (pixel centres at integers): one list
    /// for each level, or one list for all levels.
    #[must_use]
    pub fn with_keypoints(self, keypoints: Vec<Vec<[f32; 2]>>) -> Self {
        Self { keypoints, ..self }
    }

    /// The known keypoints of a level, or of the smallest level that has some; `None` if no keypoints are known.
    pub fn keypoints(&self, level: usize) -> Option<&[[f32; 2]]> {
        let last = self.keypoints.len().checked_sub(1)?;
        self.keypoints.get(level.min(last)).map(Vec::as_slice)
    }

    /// Number of levels, including the picture itself.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// The picture at 1 / 2^`level` of its size, or the smallest level, and the index of the level returned.
    pub fn level(&self, level: usize) -> (&RgbImage, usize) {
        let level = level.min(self.levels.len() - 1);
        (&self.levels[level], level)
    }

    /// Width and height in pixels.
    pub fn size_px(&self) -> (u32, u32) {
        self.levels[0].dimensions()
    }

    /// Memory of the pixels and keypoints, bytes.
    pub(super) fn bytes(&self) -> usize {
        let labels: usize = self.keypoints.iter().map(|points| 8 * points.len()).sum();
        labels
            + self
                .levels
                .iter()
                .map(|level| level.as_raw().len())
                .sum::<usize>()
    }
}

/// Mean of 2 x 2 pixels.
fn halved(image: &RgbImage) -> RgbImage {
    let (width, height) = (image.width() / 2, image.height() / 2);
    let (raw, row) = (image.as_raw(), image.width() as usize * 3);
    let mut out = Vec::with_capacity((width * height * 3) as usize);
    for y in 0..height as usize {
        for x in 0..width as usize {
            for c in 0..3 {
                let at = 2 * y * row + 6 * x + c;
                let sum = u16::from(raw[at])
                    + u16::from(raw[at + 3])
                    + u16::from(raw[at + row])
                    + u16::from(raw[at + row + 3]);
                out.push(((sum + 2) / 4) as u8);
            }
        }
    }
    RgbImage::from_raw(width, height, out).unwrap_or_default()
}
