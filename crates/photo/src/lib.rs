//! Drone photos: decoding, EXIF and XMP metadata, camera model, resampling to a query.
