//! The command line of `grim serve`.
#![cfg_attr(
    not(feature = "serve"),
    allow(
        dead_code,
        reason = "the options are the same in builds without the service"
    )
)]

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use clap::Args;
use grimnet_locate::DEFAULT_MAP_ERROR_M;

use crate::commands::map_place::MapPlace;
use crate::commands::{LimitsChoice, ModelChoice};
use crate::values;

/// Heading of the options about clients.
const CLIENTS: &str = "Access";

/// Heading of the limits.
const LIMITS: &str = "Limits";

/// Requests that may wait.
const DEFAULT_QUEUE: usize = 8;

/// Largest request, MiB.
const DEFAULT_BODY_MIB: usize = 64;

/// Longest time of one localisation, seconds.
const DEFAULT_TIME_LIMIT_S: f64 = 60.0;

/// Examples under the help of `grim serve`.
pub const EXAMPLES: &str = "\
Examples:
  grim serve --pack town.grim                              # then open http://127.0.0.1:8080
  grim serve --pack town.grim --map town.tif               # also shows the map
  grim serve --pack town.grim --listen 0.0.0.0:8080 --token-file token.txt
  curl -F photo=@a.jpg -F prior='{\"heading\": 90}' http://127.0.0.1:8080/v1/locate

SIGTERM or Ctrl-C ends it after the open requests, which takes 60 s and --time-limit at most; a second one ends it at once. \
Exit status: 0 ended, 2 wrong use or input that cannot be read.

Environment: GRIM_TOKEN holds the token if there is no --token-file.";

/// Arguments of `grim serve`.
#[derive(Debug, Args)]
pub struct ServeArgs {
    /// The map packs (made by `grim map build`)
    #[arg(short, long, value_name = "AREA.grim", required = true, num_args = 1..)]
    pub pack: Vec<PathBuf>,

    /// The maps that the packs were built from, to show them
    #[arg(long, value_name = "MAP", num_args = 1..)]
    pub map: Vec<PathBuf>,

    #[command(flatten)]
    pub place: MapPlace,

    #[command(flatten)]
    pub model: ModelChoice,

    /// Position error of the maps themselves, metres (1 sigma per axis); the stated radius includes it
    #[arg(
        long,
        value_name = "M",
        value_parser = values::sigma_m,
        allow_hyphen_values = true,
        default_value_t = DEFAULT_MAP_ERROR_M
    )]
    pub map_error: f64,

    /// Address and port to listen on; port 0 takes a free one
    ///
    /// Another address than this machine's own needs a token or --no-token. The connection is not encrypted: put a proxy with
    /// TLS in front of it.
    #[arg(long, value_name = "ADDR:PORT", default_value = "127.0.0.1:8080", value_parser = values::socket_address, help_heading = CLIENTS)]
    pub listen: SocketAddr,

    /// Require the token in this file (22 characters or more) of clients
    #[arg(long, value_name = "FILE", help_heading = CLIENTS)]
    pub token_file: Option<PathBuf>,

    /// Do not require a token
    #[arg(long, conflicts_with = "token_file", help_heading = CLIENTS)]
    pub no_token: bool,

    /// Localisations at the same time [default: one for each core]
    #[arg(long, value_name = "N", value_parser = values::threads, help_heading = LIMITS)]
    pub at_once: Option<usize>,

    /// Requests that may wait; more are answered with status 503
    #[arg(long, value_name = "N", default_value_t = DEFAULT_QUEUE, value_parser = values::count, help_heading = LIMITS)]
    pub queue: usize,

    /// Largest request, MiB
    #[arg(long, value_name = "MIB", default_value_t = DEFAULT_BODY_MIB, value_parser = values::count, help_heading = LIMITS)]
    pub max_body: usize,

    /// Longest time of one localisation with its wait, from when the photo is there, seconds
    #[arg(long, value_name = "S", default_value_t = DEFAULT_TIME_LIMIT_S, value_parser = values::duration_s, help_heading = LIMITS)]
    pub time_limit: f64,

    #[command(flatten)]
    pub limits: LimitsChoice,
}

impl ServeArgs {
    /// One pack with its map, which was drawn without error, on this machine.
    pub fn of_demo(model: ModelChoice, pack: &Path, map: &Path, listen: SocketAddr) -> Self {
        Self {
            pack: vec![pack.to_owned()],
            map: vec![map.to_owned()],
            place: MapPlace::default(),
            model,
            map_error: 0.0,
            listen,
            token_file: None,
            no_token: false,
            at_once: None,
            queue: DEFAULT_QUEUE,
            max_body: DEFAULT_BODY_MIB,
            time_limit: DEFAULT_TIME_LIMIT_S,
            limits: LimitsChoice::default(),
        }
    }
}
