//! Packs whose contents are changed and whose checksums are right.

/// A pack with another manifest, and other bytes of sections, whose checksums are all right: whoever can write a pack
/// can also write its checksums.
pub fn forged(
    bytes: &[u8],
    change: &dyn Fn(&mut serde_json::Value),
    patch: &dyn Fn(&serde_json::Value, &mut [u8]),
) -> Vec<u8> {
    let start = u64::from_le_bytes(bytes[16..24].try_into().unwrap()) as usize;
    let mut manifest: serde_json::Value = serde_json::from_slice(&bytes[start..]).unwrap();
    let mut file = bytes[..start].to_vec();
    patch(&manifest, &mut file);
    for section in manifest["sections"].as_array_mut().unwrap() {
        if section.get("block_len").is_none() {
            let at = section["offset"].as_u64().unwrap() as usize;
            let len = section["len"].as_u64().unwrap() as usize;
            section["blake3"] = blake3::hash(&file[at..at + len])
                .to_hex()
                .to_string()
                .into();
        }
    }
    change(&mut manifest);
    let json = serde_json::to_vec(&manifest).unwrap();
    file[24..32].copy_from_slice(&(json.len() as u64).to_le_bytes());
    file[32..64].copy_from_slice(blake3::hash(&json).as_bytes());
    file.extend_from_slice(&json);
    file
}
