//! Copies of pictures whose values lie in memory in any order, at about the speed of memory.

use numpy::ndarray::{ArrayView2, ArrayView3, Axis, Zip, s};

/// Side of the squares in which pictures that lie column by column are copied, pixels: source and copy of one stay in the first cache.
const TILE_PX: usize = 64;

/// The bytes of a picture of height x width x 3, row by row, the colours of a pixel together.
pub fn rgb_bytes(picture: &ArrayView3<'_, u8>) -> Vec<u8> {
    if let Some(bytes) = picture.as_slice() {
        return bytes.to_vec();
    }
    let [down, along] = [0, 1].map(|axis| picture.strides()[axis].unsigned_abs());
    if down < along {
        return by_tiles(picture);
    }
    let (height, width, _) = picture.dim();
    let mut bytes = Vec::with_capacity(3 * height * width);
    for row in picture.axis_iter(Axis(0)) {
        append_row(&row, &mut bytes);
    }
    bytes
}

/// Appends a row of pixels.
fn append_row(row: &ArrayView2<'_, u8>, bytes: &mut Vec<u8>) {
    let begin = bytes.len();
    if let Some(pixels) = row.as_slice() {
        bytes.extend_from_slice(pixels);
        return;
    }
    // Pictures of OpenCV whose colours the caller turned round.
    let mut turned = row.view();
    turned.invert_axis(Axis(1));
    if let Some(pixels) = turned.as_slice() {
        bytes.extend_from_slice(pixels);
        for pixel in bytes[begin..].as_chunks_mut::<3>().0 {
            pixel.swap(0, 2);
        }
        return;
    }
    let [red, green, blue] = [0, 1, 2].map(|band| row.column(band));
    if let (Some(red), Some(green), Some(blue)) =
        (red.as_slice(), green.as_slice(), blue.as_slice())
    {
        let pixels = red.iter().zip(green).zip(blue);
        bytes.extend(pixels.flat_map(|((&r, &g), &b)| [r, g, b]));
        return;
    }
    Zip::from(&red)
        .and(&green)
        .and(&blue)
        .for_each(|&r, &g, &b| bytes.extend_from_slice(&[r, g, b]));
}

/// A picture whose columns lie together: each square is turned in a small buffer first, so that neither side is read or written
/// with long steps.
fn by_tiles(picture: &ArrayView3<'_, u8>) -> Vec<u8> {
    let (height, width, _) = picture.dim();
    let mut bytes = vec![0; 3 * height * width];
    let mut tile = [[[0; 3]; TILE_PX]; TILE_PX];
    // Down the columns first: memory is read in its order.
    for left in (0..width).step_by(TILE_PX) {
        let columns = TILE_PX.min(width - left);
        for top in (0..height).step_by(TILE_PX) {
            let rows = TILE_PX.min(height - top);
            let square = picture.slice(s![top..top + rows, left..left + columns, ..]);
            for (column, pixels) in square.axis_iter(Axis(1)).enumerate() {
                fill_column(&mut tile, column, &pixels);
            }
            for (row, pixels) in tile.iter().enumerate().take(rows) {
                let at = 3 * ((top + row) * width + left);
                bytes[at..at + 3 * columns].copy_from_slice(pixels[..columns].as_flattened());
            }
        }
    }
    bytes
}

fn fill_column(
    tile: &mut [[[u8; 3]; TILE_PX]; TILE_PX],
    column: usize,
    pixels: &ArrayView2<'_, u8>,
) {
    if let Some(pixels) = pixels.as_slice() {
        for (row, pixel) in tile.iter_mut().zip(pixels.as_chunks::<3>().0) {
            row[column] = *pixel;
        }
        return;
    }
    for band in 0..3 {
        let values = pixels.column(band);
        match values.as_slice() {
            Some(values) => {
                for (row, &value) in tile.iter_mut().zip(values) {
                    row[column][band] = value;
                }
            }
            None => {
                for (row, &value) in tile.iter_mut().zip(values) {
                    row[column][band] = value;
                }
            }
        }
    }
}
