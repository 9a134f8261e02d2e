//! Errors in words: each cause once, and what to type.

use std::io;

use grimnet_eval::datasets::DataSetError;
use grimnet_eval::datasets::anyvisloc::AnyVisLocError;
use grimnet_geo::GeoError;
use grimnet_locate::LocateError;
use grimnet_net::{ModelFileError, NetError};
use grimnet_output::OutputError;
use grimnet_pack::PackError;
use grimnet_photo::PhotoError;

/// The error and its causes, each stated once: many libraries repeat their cause in their own message.
pub fn message(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1) {
        let cause = cause.to_string();
        if !text.contains(&cause) {
            text.push_str(": ");
            text.push_str(&cause);
        }
    }
    text
}

/// As [`message`], with the option or command of the program that helps, which libraries do not know.
pub fn message_with_hint(error: &anyhow::Error) -> String {
    let mut text = message(error);
    if let Some((option, hint)) = error.chain().find_map(hint)
        && !text.contains(option)
    {
        text.push_str(" (");
        text.push_str(hint);
        text.push(')');
    }
    text
}

/// What helps, and its name.
fn hint(error: &(dyn std::error::Error + 'static)) -> Option<(&'static str, &'static str)> {
    if let Some(error) = error.downcast_ref::<OutputError>() {
        return match error {
            OutputError::NotOwn { .. } => Some(("--overwrite", "--overwrite allows it")),
            OutputError::Io { source, .. }
                if matches!(
                    source.kind(),
                    io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem
                ) =>
            {
                Some(("may write to", "choose a folder that you may write to"))
            }
            _ => None,
        };
    }
    if let Some(error) = error.downcast_ref::<DataSetError>() {
        return match error {
            DataSetError::MsdiNeedsMap(_) | DataSetError::UnknownLayout(_) => {
                Some(("--map", "--map MAP gives the map"))
            }
            DataSetError::OffMap { .. } => {
                Some(("--crs", "--crs and --corners state where the map lies"))
            }
            DataSetError::AnyVisLoc(AnyVisLocError::NotBuilt { .. }) => Some((
                "--features",
                "cargo install --locked --path crates/cli --features anyvisloc installs one that can",
            )),
            DataSetError::Map(error) => hint(error),
            _ => None,
        };
    }
    if let Some(error) = error.downcast_ref::<PhotoError>() {
        return match error {
            PhotoError::TooLarge { .. } | PhotoError::FileTooLarge { .. } => {
                Some(("--max-photo-memory", "--max-photo-memory MIB raises it"))
            }
            _ => None,
        };
    }
    if let Some(error) = error.downcast_ref::<GeoError>() {
        return match error {
            GeoError::NoGeoreference { .. } => Some((
                "--corners",
                "--corners LL_LON,LL_LAT,UR_LON,UR_LAT gives the corners; a world file needs --crs EPSG:CODE",
            )),
            error if error.asks_for_crs() => Some((
                "--crs",
                "--crs EPSG:CODE or --crs '+proj=...' gives the coordinate system",
            )),
            _ => None,
        };
    }
    if let Some(error) = error.downcast_ref::<LocateError>() {
        return match error {
            LocateError::Pack(error) => hint(error),
            LocateError::Geo(error) => hint(error),
            LocateError::NotAPaperPack { .. } => {
                Some(("--mode", "--mode paper builds such a pack"))
            }
            _ => None,
        };
    }
    if let Some(NetError::ModelFile {
        reason: ModelFileError::MissingMetadata(_),
        ..
    }) = error.downcast_ref::<NetError>()
    {
        return Some((
            "--export",
            "grim train CONFIG --export exports a training run",
        ));
    }
    match error.downcast_ref::<PackError>()? {
        PackError::NotAPack { .. } => Some((
            "grim map build",
            "grim map build MAP -o AREA.grim makes a pack",
        )),
        PackError::ModelMismatch { .. } => Some(("--model", "--model FILE chooses the model")),
        _ => None,
    }
}

/// Whether the error is that a photo is damaged or ends early, perhaps before its first byte.
pub fn is_damaged_photo(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        matches!(
            cause.downcast_ref(),
            Some(
                PhotoError::Corrupt { .. }
                    | PhotoError::Truncated { .. }
                    | PhotoError::Empty { .. }
            )
        )
    })
}

/// Whether the error is that the reader of our output went away.
pub fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        let kind = cause.downcast_ref::<io::Error>().map(io::Error::kind);
        let json = cause
            .downcast_ref::<serde_json::Error>()
            .and_then(serde_json::Error::io_error_kind);
        let broken = Some(io::ErrorKind::BrokenPipe);
        kind == broken || json == broken
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context as _;

    #[test]
    fn each_cause_is_stated_once() {
        let inner = io::Error::other("no space left");
        let error = anyhow::Error::new(inner)
            .context("cannot write a.csv: no space left")
            .context("stopped");
        assert_eq!(
            message(&error),
            "stopped: cannot write a.csv: no space left"
        );
    }

    #[test]
    fn a_file_without_bytes_ends_early() {
        let path = std::path::PathBuf::from("a.jpg");
        let empty = PhotoError::Empty { path: path.clone() };
        assert!(is_damaged_photo(&anyhow::Error::new(empty)));
        let found = "a picture in the format Gif".to_owned();
        let other = PhotoError::Unsupported { path, found };
        assert!(!is_damaged_photo(&anyhow::Error::new(other)));
    }

    #[test]
    fn the_option_that_helps_is_that_of_any_command() {
        let error = anyhow::Error::new(PhotoError::FileTooLarge {
            path: "a.jpg".into(),
            bytes: 2,
            limit_bytes: 1,
        });
        let text = message_with_hint(&error);
        assert!(
            text.ends_with("(--max-photo-memory MIB raises it)"),
            "{text}"
        );
        let error = anyhow::Error::new(NetError::ModelFile {
            path: "checkpoint.safetensors".into(),
            reason: ModelFileError::MissingMetadata("format"),
        });
        let text = message_with_hint(&error);
        assert!(text.contains("(grim train CONFIG --export"), "{text}");
    }

    #[test]
    fn a_gone_reader_is_distinguished_from_other_errors() {
        let of = |kind: io::ErrorKind| {
            Err::<(), _>(io::Error::from(kind))
                .context("cannot write")
                .unwrap_err()
        };
        assert!(is_broken_pipe(&of(io::ErrorKind::BrokenPipe)));
        assert!(!is_broken_pipe(&of(io::ErrorKind::StorageFull)));
    }
}
