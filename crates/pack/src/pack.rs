//! Opens a pack: checks it, maps it into memory, hands out its levels.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fs_err::File;
use grimnet_geo::Georeference;
use grimnet_net::Model;
use memmap2::Mmap;

use crate::error::{PackError, Result};
use crate::format::{ALIGNMENT, FORMAT_VERSION, HEADER_LEN, Header, MAGIC};
use crate::level::Level;
use crate::manifest::{Manifest, Section};
use crate::mapped::Mapped;
use crate::mode::Mode;

/// Files up to this size are checked byte by byte when opened; larger ones are, but for their features section,
/// and [`Pack::verify`] checks the rest.
pub const FULL_CHECK_LEN: u64 = 512 << 20;

/// How much of the file is compared with its checksums on opening.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Check {
    /// Every byte.
    Full,
    /// Everything but the features sections. Whatever their bytes are, reading them is safe: a damaged
    /// descriptor matches badly.
    AllButFeatures,
}

/// A map pack, mapped into memory. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Pack {
    path: PathBuf,
    file: Arc<Mapped>,
    manifest: Arc<Manifest>,
    levels: Arc<[Level]>,
}

impl Pack {
    /// Opens a pack, checking every byte of files up to [`FULL_CHECK_LEN`].
    ///
    /// # Errors
    /// Files that cannot be read, are no pack, are truncated, damaged, empty or of another format version; the
    /// message says what to do.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let len = path
            .metadata()
            .map_err(|e| PackError::io("open", path, e))?
            .len();
        let check = if len <= FULL_CHECK_LEN {
            Check::Full
        } else {
            Check::AllButFeatures
        };
        Self::open_checked(path, check)
    }

    /// Opens a pack, checking as much as asked for.
    ///
    /// # Errors
    /// As [`Pack::open`].
    pub fn open_checked(path: impl AsRef<Path>, check: Check) -> Result<Self> {
        let path = path.as_ref();
        let error = |e| PackError::io("open", path, e);
        let file = File::open(path).map_err(error)?;
        let metadata = file.metadata().map_err(error)?;
        if !metadata.is_file() {
            return Err(PackError::NotAPack {
                path: path.to_path_buf(),
            });
        }
        let len = metadata.len();
        if len == 0 {
            return Err(PackError::Truncated {
                path: path.to_path_buf(),
                expected: HEADER_LEN,
                found: 0,
            });
        }
        // SAFETY: the mapping is read-only. Packs are never changed in place: the builder writes aside and
        // renames, which leaves the mapped inode as it is. A user who truncates the file under a running
        // program gets the system's bus error, as with any mapped file; SECURITY.md says so.
        #[allow(unsafe_code)]
        let map = unsafe { Mmap::map(file.file()) }.map_err(error)?;
        let manifest = read_manifest(path, &map)?;
        check_sections(path, &map, &manifest, check)?;
        let file = Arc::new(Mapped(map));
        let georeference = Arc::new(manifest.map.georeference.clone());
        let levels = (0..manifest.levels.len())
            .map(|i| Level::new(path, &file, &manifest, &georeference, i))
            .collect::<Result<Vec<_>>>()?;
        if levels.iter().all(|level| level.tile_count() == 0) {
            return Err(PackError::Empty {
                path: path.to_path_buf(),
                why: "all were skipped".into(),
            });
        }
        Ok(Self {
            path: path.to_path_buf(),
            file,
            manifest: Arc::new(manifest),
            levels: levels.into(),
        })
    }

    /// Compares every byte with its checksum.
    ///
    /// # Errors
    /// [`PackError::Corrupt`] names the first section that differs.
    pub fn verify(&self) -> Result<()> {
        check_sections(&self.path, &self.file.0, &self.manifest, Check::Full)
    }

    /// Refuses a model other than the one that the pack was built with.
    ///
    /// # Errors
    /// [`PackError::ModelMismatch`].
    pub fn check_model(&self, model: &Model) -> Result<()> {
        let hash = model.hash().to_string();
        if hash == self.manifest.model.hash {
            return Ok(());
        }
        let short = |hash: &str| hash.chars().take(12).collect::<String>();
        Err(PackError::ModelMismatch {
            path: self.path.clone(),
            pack_model: self.manifest.model.preset.clone(),
            pack_hash: short(&self.manifest.model.hash),
            model: model.spec().preset.clone(),
            model_hash: short(&hash),
        })
    }

    /// Where the file lies.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes of the file.
    pub fn len_bytes(&self) -> u64 {
        self.file.0.len() as u64
    }

    /// What the pack says about itself.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// `paper` or `default`.
    pub fn mode(&self) -> Mode {
        self.manifest.mode
    }

    /// The map's affine transform and coordinate system.
    pub fn georeference(&self) -> &Georeference {
        self.levels[0].georeference()
    }

    /// Levels, finest first.
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// Index of the level whose ground resolution is nearest to `gsd_m` by ratio, among those with tiles.
    pub fn nearest_level(&self, gsd_m: f64) -> usize {
        let distance = |i: &usize| (self.levels[*i].gsd_m() / gsd_m).ln().abs();
        (0..self.levels.len())
            .filter(|&i| self.levels[i].tile_count() > 0)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap_or(0)
    }
}

fn read_manifest(path: &Path, map: &[u8]) -> Result<Manifest> {
    let found = map.len() as u64;
    let truncated = |expected| PackError::Truncated {
        path: path.to_path_buf(),
        expected,
        found,
    };
    if map.get(..MAGIC.len()).is_none_or(|start| start != MAGIC) {
        return Err(PackError::NotAPack {
            path: path.to_path_buf(),
        });
    }
    let Some(header) = map.get(..HEADER_LEN as usize) else {
        return Err(truncated(HEADER_LEN));
    };
    let header: Header = bytemuck::pod_read_unaligned(header);
    if header.version != FORMAT_VERSION {
        return Err(PackError::Version {
            path: path.to_path_buf(),
            found: header.version,
            supported: FORMAT_VERSION,
        });
    }
    let end = header
        .manifest_offset
        .checked_add(header.manifest_len)
        .ok_or_else(|| PackError::corrupt(path, "header: impossible lengths"))?;
    if end > found {
        return Err(truncated(end));
    }
    if end < found || header.manifest_offset < HEADER_LEN || header.reserved != 0 {
        return Err(PackError::corrupt(
            path,
            "header: the file is longer than its contents",
        ));
    }
    let json = &map[header.manifest_offset as usize..end as usize];
    if blake3::hash(json).as_bytes() != &header.manifest_blake3 {
        return Err(PackError::corrupt(path, "manifest: checksum differs"));
    }
    serde_json::from_slice(json)
        .map_err(|e| PackError::corrupt(path, format!("manifest: not readable ({e})")))
}

/// Checks that sections lie one after the other with nothing but zeros between, and their checksums.
fn check_sections(path: &Path, map: &[u8], manifest: &Manifest, check: Check) -> Result<()> {
    let mut end = HEADER_LEN;
    for Section {
        name, offset, len, ..
    } in &manifest.sections
    {
        let next = offset
            .checked_add(*len)
            .filter(|next| *next <= map.len() as u64);
        let (Some(next), true) = (next, *offset == end.next_multiple_of(ALIGNMENT)) else {
            return Err(PackError::corrupt(
                path,
                format!("section {name}: impossible place"),
            ));
        };
        if map[end as usize..*offset as usize].iter().any(|&b| b != 0) {
            return Err(PackError::corrupt(
                path,
                format!("section {name}: padding differs"),
            ));
        }
        end = next;
    }
    let tail = end.next_multiple_of(ALIGNMENT).min(map.len() as u64);
    if map[end as usize..tail as usize].iter().any(|&b| b != 0) {
        return Err(PackError::corrupt(path, "padding differs"));
    }
    manifest.sections.iter().try_for_each(|section| {
        if check == Check::AllButFeatures && section.name.ends_with("/features") {
            return Ok(());
        }
        let bytes = &map[section.offset as usize..(section.offset + section.len) as usize];
        let mut hasher = blake3::Hasher::new();
        hasher.update_rayon(bytes);
        if hasher.finalize().to_hex().as_str() == section.blake3 {
            Ok(())
        } else {
            Err(PackError::corrupt(
                path,
                format!("section {}: checksum differs", section.name),
            ))
        }
    })
}
