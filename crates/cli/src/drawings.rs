//! Pictures of what was matched.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use grimnet_geo::Raster;
use grimnet_locate::Outcome;
use grimnet_locate::draw::{DrawOptions, draw_matches};
use grimnet_output::{OutputFolder, OutputPolicy};
use grimnet_photo::Photo;
use image::ImageFormat;

use crate::{errors, own_pictures, photos};

/// A folder with a drawing for each photo of a run.
pub struct Drawings {
    folder: OutputFolder,
    map: Option<Box<dyn Raster>>,
    /// File name for each photo.
    names: Vec<String>,
    /// How many drawings could not be made or written.
    pub failed: usize,
}

impl Drawings {
    /// The names of the files that are drawn of these photos.
    pub fn names(photos: &[PathBuf]) -> Vec<String> {
        let names = photos::picture_names(photos).into_iter();
        names.map(|name| name + ".jpg").collect()
    }

    /// Opens the folder, and checks every file name before the work begins.
    ///
    /// # Errors
    /// The folder holds a photo of the run, a drawing would replace a file that it may not replace, or the folder cannot be
    /// written.
    pub fn open(
        folder: &Path,
        policy: &OutputPolicy,
        photos: &[PathBuf],
        map: Option<Box<dyn Raster>>,
    ) -> Result<Self> {
        let names = Self::names(photos);
        if let Some(photo) = photos.iter().find(|photo| is_directly_in(photo, folder)) {
            bail!(
                "{}: {} is in this folder, and drawings have the names of their photos; choose another folder than that of the \
                 photos",
                folder.display(),
                photo.display()
            );
        }
        let folder = OutputFolder::open(folder, policy)?;
        folder.check(&names)?;
        Ok(Self {
            folder,
            map,
            names,
            failed: 0,
        })
    }

    /// Draws the answer of one photo. A failure is reported and counted: the answers are worth more than a picture.
    pub fn draw(&mut self, number: usize, photo: &Photo, outcome: &Outcome) {
        let drawn = jpeg_of(photo, outcome, self.map.as_deref());
        self.put(number, drawn);
    }

    /// Leaves no drawing of a photo that cannot be read.
    pub fn leave_out(&mut self, number: usize) {
        self.put(number, Ok(None));
    }

    fn put(&mut self, number: usize, drawn: Result<Option<Vec<u8>>>) {
        let name = &self.names[number];
        let put = drawn.and_then(|jpeg| match jpeg {
            Some(jpeg) => Ok(self.folder.write_bytes(name, &jpeg)?),
            // The drawing of an earlier run would show another answer than this one.
            None => Ok(self.folder.prune(|earlier| earlier == name)?),
        });
        if let Err(error) = put {
            self.failed += 1;
            tracing::error!("no drawing {name}: {}", errors::message(&error));
        }
    }
}

/// Whether a folder that is there holds a file, by whatever names they are given.
fn is_directly_in(file: &Path, folder: &Path) -> bool {
    let parent = match file.parent() {
        Some(parent) if parent.as_os_str().is_empty() => Path::new("."),
        Some(parent) => parent,
        None => return false,
    };
    // What cannot be resolved is not there: `locate` says so of a photo, and the folder is made.
    matches!((parent.canonicalize(), folder.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// A JPEG of one answer's matches; `None` if nothing was matched.
///
/// # Errors
/// The map cannot be read, or the picture not be encoded.
pub fn jpeg_of(
    photo: &Photo,
    outcome: &Outcome,
    map: Option<&dyn Raster>,
) -> Result<Option<Vec<u8>>> {
    let matched = match outcome {
        Outcome::Fix(fix) => fix.drawn.as_deref(),
        Outcome::NoFix(no_fix) => no_fix.drawn.as_deref(),
    };
    let Some(matched) = matched else {
        return Ok(None);
    };
    let drawn = draw_matches(photo, matched, map, &DrawOptions::default())?;
    let jpeg = own_pictures::encoded(&drawn, ImageFormat::Jpeg);
    jpeg.context("cannot encode the drawing").map(Some)
}
