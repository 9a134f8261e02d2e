//! The file of `grim track --session`: a track with its map, which opens without any server.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use grimnet_locate::Localizer;
use grimnet_output::OutputPolicy;
use grimnet_serve::{ServedMap, TrackFrame, session_page};

use super::map_place::MapPlace;
use crate::tracking::session::Tracked;

/// A file that is written when the flight ends, checked before it.
pub struct SessionFile<'a> {
    path: &'a Path,
    policy: &'a OutputPolicy,
    map: ServedMap,
    frames: Vec<TrackFrame>,
}

impl<'a> SessionFile<'a> {
    /// Opens the map, if it is given.
    ///
    /// # Errors
    /// The file may not be replaced, or the map cannot be read or is another one.
    pub fn open(
        path: &'a Path,
        policy: &'a OutputPolicy,
        localizer: Arc<Localizer>,
        map: Option<&Path>,
        place: &MapPlace,
    ) -> Result<Self> {
        let raster = map
            .map(|path| place.open_of_pack(path, policy, localizer.pack()))
            .transpose()?;
        policy.check_file(path, &[])?;
        let name = localizer
            .pack()
            .path()
            .file_stem()
            .unwrap_or_default()
            .to_owned();
        Ok(Self {
            path,
            policy,
            map: ServedMap::new(&name.to_string_lossy(), localizer, raster.map(Into::into))?,
            frames: Vec::new(),
        })
    }

    /// Takes in a frame.
    pub fn add(&mut self, tracked: &Tracked) {
        self.frames.push(TrackFrame::new(
            self.frames.len() as u64 + 1,
            tracked.time_s,
            &tracked.searched,
            tracked.point,
            tracked.answer.clone(),
        ));
    }

    /// Writes the file.
    ///
    /// # Errors
    /// The map cannot be read, or the file not be written.
    pub fn write(&self) -> Result<()> {
        let title = format!("Flight on {}", self.map.id());
        let page = session_page(&title, &self.map, &self.frames)?;
        self.policy.write(self.path, |file| {
            std::io::Write::write_all(file, page.as_bytes())
        })?;
        Ok(())
    }
}
