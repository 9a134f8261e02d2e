//! Opens packs and maps, and serves them.

use std::io::Write as _;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use grimnet_geo::{Raster, open_map};
use grimnet_locate::{Localizer, Options};
use grimnet_net::Model;
use grimnet_pack::Pack;
use grimnet_serve::{Access, Limits, ServeError, ServedMap, Service, Token};

use super::ServeArgs;
use crate::commands::map_place::is_built_from;
use crate::exit::Exit;
use crate::inputs;
use crate::localise::open_pack;
use crate::standard_output::StandardOutput;

/// The environment variable of the token.
const TOKEN_VARIABLE: &str = "GRIM_TOKEN";

/// Largest token file, bytes.
const MAX_TOKEN_BYTES: u64 = 4096;

/// Serves until a signal.
///
/// # Errors
/// Unreadable pack, model, map or token; an address that cannot be listened on.
pub fn run(arguments: &ServeArgs) -> Result<Exit> {
    arguments.place.check_is_used(!arguments.map.is_empty())?;
    let token_file = arguments.token_file.as_deref();
    let access = access(arguments.listen, token_file, arguments.no_token)?;
    let limits = limits(arguments);
    let options = Options {
        keep_matches: true,
        map_error_m: arguments.map_error,
        // Nobody waits any longer.
        budget_ms: Some(limits.locate_time.as_secs_f64() * 1e3),
        ..Options::default()
    };
    let maps = maps(arguments, &options)?;
    let service = Service::bind(arguments.listen, access, maps, limits)?;
    announce(&service)?;
    service.run(true)?;
    Ok(Exit::Done)
}

/// Checks that the address may be listened on without an option for access, and is free.
///
/// # Errors
/// It may not, or cannot.
pub fn check_address(address: SocketAddr) -> Result<()> {
    access(address, None, false)?;
    std::net::TcpListener::bind(address)
        .map_err(|source| ServeError::Listen { address, source })?;
    Ok(())
}

/// Prints where the service is.
///
/// # Errors
/// Standard output cannot be written.
pub fn announce(service: &Service) -> Result<()> {
    let mut out = StandardOutput;
    writeln!(out, "http://{}", service.address())?;
    out.flush()?;
    Ok(())
}

fn limits(arguments: &ServeArgs) -> Limits {
    let standard = Limits::default();
    Limits {
        photo: arguments.limits.photo_or(standard.photo),
        max_body_bytes: arguments.max_body.saturating_mul(1 << 20),
        at_once: arguments.at_once.unwrap_or(standard.at_once),
        queue: arguments.queue,
        locate_time: Duration::from_secs_f64(arguments.time_limit),
        ..standard
    }
}

fn access(listen: SocketAddr, token_file: Option<&Path>, no_token: bool) -> Result<Access> {
    if no_token {
        if !listen.ip().is_loopback() {
            tracing::warn!(
                "no token is asked for: everybody who reaches {listen} can use the service"
            );
        }
        return Ok(Access::Everybody);
    }
    let (text, source) = match token_file {
        Some(path) => (read_token(path)?, path.display().to_string()),
        None => match std::env::var_os(TOKEN_VARIABLE) {
            // One that is not UTF-8 is refused below, and not taken for none.
            Some(text) => (
                text.to_string_lossy().into_owned(),
                TOKEN_VARIABLE.to_owned(),
            ),
            None if listen.ip().is_loopback() => return Ok(Access::ThisMachine),
            None => bail!(
                "{listen} can be reached from other machines; give a token that clients must send, in the variable {TOKEN_VARIABLE} or \
                 with --token-file FILE of `grim serve`, or serve everybody with its --no-token"
            ),
        },
    };
    Token::new(&text).map(Access::WithToken).with_context(|| {
        format!(
            "{source}: expected a token of {} or more printable ASCII characters without spaces, such as the output of: \
             openssl rand -hex 16",
            Token::MIN_CHARACTERS
        )
    })
}

fn read_token(path: &Path) -> Result<String> {
    inputs::check_regular(path)?;
    let length = fs_err::metadata(path)?.len();
    if length > MAX_TOKEN_BYTES {
        bail!(
            "{}: {length} bytes; expected a file that holds a token and nothing else",
            path.display()
        );
    }
    Ok(fs_err::read_to_string(path)?)
}

/// The packs with the maps that they were built from.
fn maps(arguments: &ServeArgs, options: &Options) -> Result<Vec<ServedMap>> {
    let model = arguments.model.open()?;
    let mut packs = Vec::new();
    for path in &arguments.pack {
        packs.push((open_pack(path, options.mode)?, None));
    }
    for path in &arguments.map {
        inputs::check_map(path)?;
        let map: Arc<dyn Raster> = open_map(path, &arguments.place.options())?.into();
        let mut has_pack = false;
        for (pack, its_map) in &mut packs {
            if is_built_from(pack, map.as_ref())? {
                *its_map = Some(map.clone());
                has_pack = true;
            }
        }
        if !has_pack {
            bail!(
                "{}: none of the packs was built from this map, or it was changed since; give the maps of the packs, or build \
                 the packs again",
                path.display()
            );
        }
    }
    packs
        .into_iter()
        .zip(&arguments.pack)
        .map(|((pack, map), path)| served(&model, pack, map, path, options))
        .collect()
}

fn served(
    model: &Model,
    pack: Pack,
    map: Option<Arc<dyn Raster>>,
    path: &Path,
    options: &Options,
) -> Result<ServedMap> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let localizer = Localizer::new(model.clone(), pack)?.with_options(options.clone());
    Ok(ServedMap::new(&name, localizer, map)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::ModelChoice;

    #[test]
    fn defaults_of_the_options_are_those_of_the_library() {
        let (pack, map) = (Path::new("a.grim"), Path::new("a.tif"));
        let listen = SocketAddr::from(([127, 0, 0, 1], 8080));
        let arguments = ServeArgs::of_demo(ModelChoice::default(), pack, map, listen);
        assert_eq!(limits(&arguments), Limits::default());
    }
}
