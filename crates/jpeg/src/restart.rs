//! Restart markers between the intervals of a scan (ITU-T T.81, B.2.1 and E.1.4).

use crate::bits::Bits;
use crate::damage::{Checked, Damage};

/// Goes behind the restart marker with this number, 0 to 7, of which only padding may be left.
pub(crate) fn take_restart_marker(bits: &mut Bits<'_>, number: u8) -> Checked<()> {
    let at = bits.end()?;
    match marker_at(bits.bytes(), at) {
        Some((marker, behind)) if marker == 0xD0 + number => {
            *bits = Bits::new(bits.bytes(), behind);
            Ok(())
        }
        _ => Err(Damage::RestartMarker),
    }
}

/// The marker at a position, behind fill bytes, and the position behind it.
pub(crate) fn marker_at(bytes: &[u8], at: usize) -> Option<(u8, usize)> {
    let rest = bytes.get(at..)?;
    let fill = rest.iter().take_while(|&&byte| byte == 0xFF).count();
    let marker = *rest.get(fill)?;
    (fill > 0).then_some((marker, at + fill + 1))
}
