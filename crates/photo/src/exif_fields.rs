//! Reads an EXIF structure into [`Metadata`].

use exif::{Context, Exif, In, Tag, Value};

use crate::container::MAX_BLOCK_BYTES;
use crate::exposure_time::ExposureTime;
use crate::metadata::{ImageDirection, Metadata};

/// Where XMP packets are in EXIF: tag 700 of the first directory, as in a TIFF file (XMP part 3, section 3.2), or of the sub-directory,
/// where some firmwares of DJI write it.
const XMP: [Tag; 2] = [Tag(Context::Tiff, 700), Tag(Context::Exif, 700)];

/// Reads an EXIF structure, and gives the XMP packets in it. A structure that cannot be parsed gives a note only.
pub(crate) fn read_into(bytes: Vec<u8>, metadata: &mut Metadata) -> Vec<Vec<u8>> {
    let parsed = exif::Reader::new()
        .continue_on_error(true)
        .read_raw(bytes)
        .or_else(|error| {
            error.distill_partial_result(|errors| {
                tracing::debug!(count = errors.len(), "EXIF read in part");
            })
        });
    let exif = match parsed {
        Ok(exif) => exif,
        Err(error) => {
            metadata.note("EXIF", error.to_string(), "not readable");
            return Vec::new();
        }
    };
    let orientation = exif
        .get_field(Tag::Orientation, In::PRIMARY)
        .and_then(|field| field.value.get_uint(0));
    match orientation {
        None => {}
        Some(value @ 1..=8) => metadata.orientation = value as u8,
        Some(value) => metadata.note("Orientation", value.to_string(), "not one of 1 to 8"),
    }
    metadata.make = text(&exif, Tag::Make);
    metadata.model = text(&exif, Tag::Model);
    metadata.exposure_time = exposure_time(&exif);
    metadata.focal_length_mm = positive(&exif, Tag::FocalLength, "FocalLength", 2000.0, metadata);
    metadata.focal_35mm = positive(
        &exif,
        Tag::FocalLengthIn35mmFilm,
        "FocalLengthIn35mmFilm",
        3000.0,
        metadata,
    );
    metadata.digital_zoom = positive(
        &exif,
        Tag::DigitalZoomRatio,
        "DigitalZoomRatio",
        1000.0,
        metadata,
    );
    let side = |tag| {
        exif.get_field(tag, In::PRIMARY)
            .and_then(|field| field.value.get_uint(0))
            .filter(|&px| px > 0)
    };
    metadata.original_size_px = side(Tag::PixelXDimension).zip(side(Tag::PixelYDimension));
    metadata.focal_plane_px = focal_plane_px(&exif, metadata.focal_length_mm);
    read_gps(&exif, metadata);
    xmp_packets(&exif)
}

fn xmp_packets(exif: &Exif) -> Vec<Vec<u8>> {
    let bytes_of = |tag: Tag| match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Byte(bytes) | Value::Undefined(bytes, _) => Some(bytes),
        _ => None,
    };
    let packets = XMP.into_iter().filter_map(bytes_of);
    packets
        .filter(|bytes| bytes.len() <= MAX_BLOCK_BYTES)
        .cloned()
        .collect()
}

/// When the photo was taken: `DateTimeOriginal` with its fraction and zone, else `DateTime` with those.
fn exposure_time(exif: &Exif) -> Option<ExposureTime> {
    let at = |date, fraction, zone| {
        let (fraction, zone) = (text(exif, fraction), text(exif, zone));
        ExposureTime::from_exif(&text(exif, date)?, fraction.as_deref(), zone.as_deref())
    };
    at(
        Tag::DateTimeOriginal,
        Tag::SubSecTimeOriginal,
        Tag::OffsetTimeOriginal,
    )
    .or_else(|| at(Tag::DateTime, Tag::SubSecTime, Tag::OffsetTime))
}

fn read_gps(exif: &Exif, metadata: &mut Metadata) {
    if let (Some(lat), Some(lon)) = (
        degrees(exif, Tag::GPSLatitude),
        degrees(exif, Tag::GPSLongitude),
    ) {
        let south = text(exif, Tag::GPSLatitudeRef).is_some_and(|r| r.starts_with(['S', 's']));
        let west = text(exif, Tag::GPSLongitudeRef).is_some_and(|r| r.starts_with(['W', 'w']));
        metadata.take_position(
            "EXIF GPSLatitude, GPSLongitude",
            if south { -lat } else { lat },
            if west { -lon } else { lon },
        );
    }
    if let Some(altitude) = number(exif, Tag::GPSAltitude, 0) {
        // GPSAltitudeRef 1: below the reference.
        let below = exif
            .get_field(Tag::GPSAltitudeRef, In::PRIMARY)
            .is_some_and(
                |field| matches!(&field.value, Value::Byte(bytes) if bytes.first() == Some(&1)),
            );
        if altitude.is_finite() && altitude.abs() < 100_000.0 {
            metadata.gps_altitude_m = Some(if below { -altitude } else { altitude });
        } else {
            metadata.note("EXIF GPSAltitude", altitude.to_string(), "not a height");
        }
    }
    if let Some(bearing) = number(exif, Tag::GPSImgDirection, 0) {
        if (0.0..=360.0).contains(&bearing) {
            let reference = text(exif, Tag::GPSImgDirectionRef);
            metadata.image_direction = Some(ImageDirection {
                bearing_deg: bearing,
                magnetic: reference.is_some_and(|r| r.starts_with(['M', 'm'])),
            });
        } else {
            metadata.note("EXIF GPSImgDirection", bearing.to_string(), "not a bearing");
        }
    }
}

/// Focal length in pixels from the pixel density of the sensor (EXIF tags 0xA20E and 0xA210).
fn focal_plane_px(exif: &Exif, focal_length_mm: Option<f64>) -> Option<f64> {
    let focal_mm = focal_length_mm?;
    let per_unit = number(exif, Tag::FocalPlaneXResolution, 0)?;
    let unit_mm = match exif
        .get_field(Tag::FocalPlaneResolutionUnit, In::PRIMARY)
        .and_then(|field| field.value.get_uint(0))
    {
        Some(3) => 10.0,
        Some(4) => 1.0,
        Some(5) => 0.001,
        _ => 25.4, // inch, the standard's default
    };
    let focal_px = focal_mm * per_unit / unit_mm;
    (focal_px.is_finite() && (50.0..200_000.0).contains(&focal_px)).then_some(focal_px)
}

/// The first text of a field, without the padding that cameras add; `None` if it is empty.
fn text(exif: &Exif, tag: Tag) -> Option<String> {
    let Value::Ascii(lines) = &exif.get_field(tag, In::PRIMARY)?.value else {
        return None;
    };
    let line = lines.first()?;
    let text = String::from_utf8_lossy(line);
    let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
    (!text.is_empty()).then(|| text.to_owned())
}

/// One number of a field; rationals with denominator 0 give NaN or infinity.
fn number(exif: &Exif, tag: Tag, index: usize) -> Option<f64> {
    let value = &exif.get_field(tag, In::PRIMARY)?.value;
    match value {
        Value::Rational(v) => v.get(index).map(|r| r.to_f64()),
        Value::SRational(v) => v.get(index).map(|r| r.to_f64()),
        Value::Float(v) => v.get(index).map(|&x| f64::from(x)),
        Value::Double(v) => v.get(index).copied(),
        _ => value.get_uint(index).map(f64::from),
    }
}

/// A number above zero; cameras write 0 for "unknown" (EXIF 2.32, 4.6.5), which needs no note.
fn positive(exif: &Exif, tag: Tag, name: &str, limit: f64, metadata: &mut Metadata) -> Option<f64> {
    let value = number(exif, tag, 0)?;
    if value.is_finite() && value > 0.0 && value < limit {
        return Some(value);
    }
    if value != 0.0 {
        metadata.note(
            &format!("EXIF {name}"),
            value.to_string(),
            "not a usable number",
        );
    }
    None
}

/// Degrees, minutes and seconds as one number.
fn degrees(exif: &Exif, tag: Tag) -> Option<f64> {
    let whole = number(exif, tag, 0)?;
    let minutes = number(exif, tag, 1).unwrap_or(0.0);
    let seconds = number(exif, tag, 2).unwrap_or(0.0);
    Some(whole + minutes / 60.0 + seconds / 3600.0)
}
