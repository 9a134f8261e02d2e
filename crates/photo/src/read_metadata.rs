//! Reads EXIF and XMP of a photo file.

use std::path::Path;

use grimnet_limits::PhotoLimits;

use crate::container::Embedded;
use crate::error::PhotoError;
use crate::metadata::Metadata;
use crate::photo_file::read_photo_file;
use crate::{exif_fields, xmp_fields};

impl Metadata {
    /// Reads the metadata of a photo without decoding its pixels.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read or is larger than the default limit. Damaged metadata are no error: they are left out, with an entry in
    /// [`Metadata::notes`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self, PhotoError> {
        Self::read_within(path, &PhotoLimits::DEFAULT)
    }

    /// As [`Metadata::read`], within other limits.
    ///
    /// # Errors
    /// As [`Metadata::read`].
    pub fn read_within(path: impl AsRef<Path>, limits: &PhotoLimits) -> Result<Self, PhotoError> {
        let bytes = read_photo_file(path.as_ref(), limits)?;
        Ok(Self::from_bytes(&bytes))
    }

    /// Reads the metadata from the bytes of a photo file. Metadata that cannot be read are left out, with an entry in
    /// [`Metadata::notes`].
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let embedded = Embedded::find(bytes);
        let mut metadata = Self {
            orientation: 1,
            ..Self::default()
        };
        let has_exif = embedded.exif.is_some();
        let in_exif = match embedded.exif {
            Some(exif) => exif_fields::read_into(exif, &mut metadata),
            None => Vec::new(),
        };
        if embedded.has_unread_texts && embedded.xmp.is_empty() {
            let reason = "in texts of the PNG file that are not read; save the photo as JPEG, with its metadata";
            let field = if has_exif { "XMP" } else { "EXIF, XMP" };
            metadata.note(field, "compressed or raw profile", reason);
        }
        xmp_fields::read_into(&embedded.xmp, &in_exif, &mut metadata);
        metadata
    }
}
