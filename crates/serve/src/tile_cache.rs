//! Tiles that were rendered before.

use std::collections::{HashMap, VecDeque};
use std::sync::{Mutex, PoisonError};

use axum::body::Bytes;
use axum::http::HeaderValue;

use crate::tile_address::TileAddress;

/// Bytes that all tiles together may take.
const MAX_BYTES: usize = 64 << 20;

/// What a tile takes besides its bytes: its keys, its tag and its places in the tables, at most. Tiles far from the map have few
/// bytes, and there are very many.
const BYTES_BESIDE: usize = 512;

/// What a tile shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Layer {
    /// The map.
    Map,
    /// The tiles of the pack.
    Outlines,
}

/// Which tile of which map.
pub(crate) type TileKey = (String, Layer, TileAddress);

/// An encoded tile.
#[derive(Debug, Clone)]
pub(crate) struct Tile {
    pub bytes: Bytes,
    pub media_type: &'static str,
    pub tag: HeaderValue,
}

/// The latest tiles, the oldest given up first.
#[derive(Debug, Default)]
pub(crate) struct TileCache(Mutex<Held>);

#[derive(Debug, Default)]
struct Held {
    tiles: HashMap<TileKey, Tile>,
    order: VecDeque<TileKey>,
    bytes: usize,
}

impl TileCache {
    pub(crate) fn get(&self, key: &TileKey) -> Option<Tile> {
        let held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        held.tiles.get(key).cloned()
    }

    pub(crate) fn insert(&self, key: TileKey, tile: Tile) {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        held.bytes += size(&tile);
        if let Some(old) = held.tiles.insert(key.clone(), tile) {
            held.bytes -= size(&old);
        } else {
            held.order.push_back(key);
        }
        while held.bytes > MAX_BYTES {
            let Some(oldest) = held.order.pop_front() else {
                break;
            };
            if let Some(tile) = held.tiles.remove(&oldest) {
                held.bytes -= size(&tile);
            }
        }
    }
}

fn size(tile: &Tile) -> usize {
    tile.bytes.len() + BYTES_BESIDE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_tiles_are_given_up() {
        let cache = TileCache::default();
        let key = |x: u32| {
            let address = TileAddress::new(10, x, 0).unwrap();
            ("town".to_owned(), Layer::Map, address)
        };
        let tile = |bytes: usize| Tile {
            bytes: vec![0; bytes - BYTES_BESIDE].into(),
            media_type: "image/png",
            tag: HeaderValue::from_static("\"a\""),
        };
        cache.insert(key(0), tile(MAX_BYTES / 2));
        cache.insert(key(1), tile(MAX_BYTES / 4));
        cache.insert(key(1), tile(MAX_BYTES / 4));
        assert!(cache.get(&key(0)).is_some());
        cache.insert(key(2), tile(MAX_BYTES / 2));
        assert!(cache.get(&key(0)).is_none());
        assert!(cache.get(&key(1)).is_some() && cache.get(&key(2)).is_some());
    }

    #[test]
    fn empty_tiles_are_not_kept_without_bound() {
        let cache = TileCache::default();
        for x in 0..200_000 {
            let address = TileAddress::new(24, x, 0).unwrap();
            let tile = Tile {
                bytes: Bytes::new(),
                media_type: "image/png",
                tag: HeaderValue::from_static("\"a\""),
            };
            cache.insert(("town".to_owned(), Layer::Map, address), tile);
        }
        let held = cache.0.lock().unwrap();
        assert!(held.tiles.len() <= MAX_BYTES / BYTES_BESIDE);
        assert_eq!(held.tiles.len(), held.order.len());
    }
}
