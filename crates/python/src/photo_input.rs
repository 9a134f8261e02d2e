//! Photos as Python gives them: a path, the bytes of a file, or pixels.

use std::path::{Path, PathBuf};

use grimnet_locate::NeededPixels;
use grimnet_photo::{MIN_SIDE_PX, Metadata, Photo, PhotoError, PhotoLimits, read_photo_file};
use image::RgbImage;
use numpy::ndarray::{ArrayView, Dimension};
use numpy::{
    IntoPyArray, PyArray3, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods, get_array_module,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyByteArray, PyBytes, PyMemoryView, PyString};

use crate::errors::{invalid_value, photo_error, whole_number};
use crate::long_work::detached;
use crate::rgb_copy::rgb_bytes;

/// How bytes and pixels are named in errors.
const OF_BYTES: &str = "the photo";

/// What a photo is given as. Pixels are copied, and bytes that may change (`bytearray`, `memoryview`).
pub enum PhotoInput {
    /// A file.
    Path(PathBuf),
    /// The contents of a file.
    Bytes(PyBackedBytes),
    /// Height x width x 3, 8 bits, red, green, blue.
    Pixels(RgbImage),
}

impl PhotoInput {
    /// Takes `str`, `os.PathLike`, `bytes`, `bytearray`, `memoryview`, arrays, and what numpy makes an array of.
    ///
    /// # Errors
    /// `TypeError` for anything else; `InvalidValueError` for an array of another type or shape than height x width x 3 of uint8, and for a
    /// picture of Pillow of another mode than RGB; `PhotoError` for an array of more bytes than a photo may take.
    pub fn of(photo: &Bound<'_, PyAny>) -> PyResult<Self> {
        if photo.is_instance_of::<PyBytes>() || photo.is_instance_of::<PyByteArray>() {
            return Ok(Self::Bytes(photo.extract()?));
        }
        if photo.is_instance_of::<PyMemoryView>() {
            return Ok(Self::Bytes(photo.call_method0("tobytes")?.extract()?));
        }
        if photo.is_instance_of::<PyString>() || photo.hasattr("__fspath__")? {
            return Ok(Self::Path(photo.extract()?));
        }
        if let Ok(array) = photo.cast::<PyUntypedArray>() {
            return pixels(array).map(Self::Pixels);
        }
        if photo.hasattr("__array__")? || photo.hasattr("__array_interface__")? {
            check_mode(photo)?;
            let array = get_array_module(photo.py())?.call_method1("asarray", (photo,))?;
            return pixels(array.cast::<PyUntypedArray>()?).map(Self::Pixels);
        }
        Err(PyTypeError::new_err(format!(
            "a photo is a path, the bytes of a picture file, or an array of height x width x 3 of uint8 (RGB), not {}",
            photo.get_type().name()?
        )))
    }

    /// How the photo is named in answers.
    pub fn name(&self) -> String {
        match self {
            Self::Path(path) => path.display().to_string(),
            Self::Bytes(_) => "bytes".to_owned(),
            Self::Pixels(_) => "array".to_owned(),
        }
    }

    /// Decodes the photo, to a long side of at most `max_side_px`; pixels are reduced to it alike. This takes long.
    ///
    /// # Errors
    /// `PhotoError`.
    pub fn decode(self, max_side_px: Option<u32>) -> PyResult<Photo> {
        match (self, max_side_px) {
            (Self::Pixels(image), Some(side_px)) => {
                let metadata = Metadata::default();
                Ok(Photo::from_image_reduced(image, metadata, side_px))
            }
            (input, _) => input.photo(|name, bytes| Photo::from_bytes(name, bytes, max_side_px)),
        }
    }

    /// Decodes the photo with as many pixels as the search over a map can use; pixels stay as they are. This takes long.
    ///
    /// # Errors
    /// `PhotoError`.
    pub fn decode_as_needed(self, needed: &NeededPixels) -> PyResult<Photo> {
        self.photo(|name, bytes| needed.decode(name, bytes, &PhotoLimits::DEFAULT))
    }

    /// The photo, where `decode` makes it of the bytes of a file, which it names in errors.
    fn photo(
        self,
        decode: impl FnOnce(&Path, &[u8]) -> Result<Photo, PhotoError>,
    ) -> PyResult<Photo> {
        let photo = match self {
            Self::Path(path) => read_photo_file(&path, &PhotoLimits::DEFAULT)
                .and_then(|bytes| decode(&path, &bytes)),
            Self::Bytes(bytes) => decode(Path::new(OF_BYTES), &bytes),
            Self::Pixels(image) => Ok(Photo::from_image(image, Metadata::default())),
        };
        photo.map_err(|error| photo_error(&error))
    }
}

/// Checks the mode of a picture of Pillow: the array of one in `HSV`, `LAB` or `YCbCr` has the shape and type of one in RGB.
fn check_mode(photo: &Bound<'_, PyAny>) -> PyResult<()> {
    // Arrays of other packages have no mode, or a method of that name.
    let Ok(mode) = photo.getattr("mode") else {
        return Ok(());
    };
    match mode.extract::<String>() {
        Ok(mode) if mode != "RGB" => Err(invalid_value(format!(
            "a picture of mode {mode} is no photo; expected RGB: `picture.convert(\"RGB\")`"
        ))),
        _ => Ok(()),
    }
}

/// Copies an array to a picture.
fn pixels(array: &Bound<'_, PyUntypedArray>) -> PyResult<RgbImage> {
    let wrong = || {
        let sides: Vec<String> = array.shape().iter().map(usize::to_string).collect();
        let advice = match array.shape() {
            [_, _] => "of a grey picture take `numpy.dstack([picture] * 3)`",
            [_, _, 4] => "`picture[:, :, :3]` leaves out the fourth band",
            _ => "of OpenCV's pictures take `picture[:, :, ::-1]`",
        };
        invalid_value(format!(
            "an array of shape ({}) and type {} is no photo; expected height x width x 3 of uint8 in the order red, green, blue ({advice})",
            sides.join(", "),
            array.dtype()
        ))
    };
    let &[height, width, 3] = array.shape() else {
        return Err(wrong());
    };
    let array = array.cast::<PyArray3<u8>>().map_err(|_| wrong())?;
    let side = |length: usize| u32::try_from(length).ok().filter(|px| *px >= MIN_SIDE_PX);
    let (Some(width_px), Some(height_px)) = (side(width), side(height)) else {
        return Err(invalid_value(format!(
            "the photo has {width} x {height} px; each side must be at least {MIN_SIDE_PX} px"
        )));
    };
    // As of files: the lack of memory would end the process.
    let needed_bytes = (u64::from(width_px) * u64::from(height_px)).saturating_mul(3);
    let limit_bytes = PhotoLimits::DEFAULT.max_memory_bytes;
    if needed_bytes > limit_bytes {
        return Err(photo_error(&PhotoError::TooLarge {
            path: OF_BYTES.into(),
            width_px,
            height_px,
            needed_bytes,
            limit_bytes,
        }));
    }
    let readable = array.try_readonly().map_err(|error| {
        invalid_value(format!(
            "the array is being written to by another thread: {error}"
        ))
    })?;
    let bytes = rgb_bytes(&readable.as_array());
    RgbImage::from_raw(width_px, height_px, bytes).ok_or_else(wrong)
}

/// A copy of an array's values, the last index running fastest, however they lie in memory.
pub fn row_by_row<T: Copy, D: Dimension>(array: &ArrayView<'_, T, D>) -> Vec<T> {
    // The slice of numpy's own interface may be column by column.
    match array.as_slice() {
        Some(contiguous) => contiguous.to_vec(),
        None => array.iter().copied().collect(),
    }
}

/// The argument `max_side_px`.
///
/// # Errors
/// `InvalidValueError` for a number that is no side of a picture.
pub fn max_side_of(given: Option<i64>) -> PyResult<Option<u32>> {
    if given == Some(0) {
        return Err(invalid_value("max_side_px is 0; expected at least 1"));
    }
    given
        .map(|side_px| whole_number("max_side_px", side_px, u32::MAX))
        .transpose()
}

/// Reads a photo as an array of height x width x 3 of uint8, red, green, blue, turned as its EXIF orientation says.
///
/// `max_side_px` reduces it by averaging areas; a smaller photo keeps its size.
#[pyfunction]
#[pyo3(signature = (photo, *, max_side_px=None))]
pub fn read_photo<'py>(
    photo: &Bound<'py, PyAny>,
    max_side_px: Option<i64>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let py = photo.py();
    let max_side_px = max_side_of(max_side_px)?;
    let input = PhotoInput::of(photo)?;
    let image = detached(py, || Ok(input.decode(max_side_px)?.image))?;
    py.check_signals()?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    image
        .into_raw()
        .into_pyarray(py)
        .reshape([height, width, 3])
}
