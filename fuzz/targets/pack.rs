//! Packs, their checksums made right: whoever can write a pack can also write its checksums.
#![no_main]

use grimnet_fuzz_targets::{assert_named, file_of};
use grimnet_pack::Pack;
use libfuzzer_sys::fuzz_target;

/// Makes the checksums of the manifest and of its sections right, if the file has a manifest.
fn with_checksums(bytes: &[u8]) -> Option<Vec<u8>> {
    let start = u64::from_le_bytes(bytes.get(16..24)?.try_into().ok()?) as usize;
    let mut manifest: serde_json::Value = serde_json::from_slice(bytes.get(start..)?).ok()?;
    let mut file = bytes[..start].to_vec();
    if let Some(sections) = manifest
        .get_mut("sections")
        .and_then(|sections| sections.as_array_mut())
    {
        for section in sections {
            let (at, len) = (section["offset"].as_u64()?, section["len"].as_u64()?);
            let end = at.checked_add(len)?;
            if let Some(content) = file.get(at as usize..end as usize) {
                section["blake3"] = blake3::hash(content).to_hex().to_string().into();
            }
        }
    }
    let json = serde_json::to_vec(&manifest).ok()?;
    file.get_mut(24..32)?
        .copy_from_slice(&(json.len() as u64).to_le_bytes());
    file.get_mut(32..64)?
        .copy_from_slice(blake3::hash(&json).as_bytes());
    file.extend(json);
    Some(file)
}

fuzz_target!(|bytes: &[u8]| {
    let file = with_checksums(bytes);
    let path = file_of(file.as_deref().unwrap_or(bytes), "area.grim");
    let pack = match Pack::open(&path) {
        Ok(pack) => pack,
        Err(error) => return assert_named(&error, "area.grim"),
    };
    for level in pack.levels() {
        for tile in 0..level.tile_count().min(4) {
            let _ = level.tile_at(level.tile(tile).grid);
            let _ = level.blocks(tile);
            let _ = level.features(tile);
            assert_eq!(level.global(tile).len(), level.global_dim());
        }
        let _ = level.statistics();
    }
    let _ = pack.verify(&mut |_| {});
    let _ = pack.info().to_string();
});
