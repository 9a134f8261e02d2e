//! Options of every command: how much is logged, and how many threads compute.

use clap::ArgAction;
use grimnet_answer::printable_text;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::field::MakeExt as _;
use tracing_subscriber::fmt::format;

use crate::{file_size, terminal, values};

/// Heading of these options in the help.
const GENERAL: &str = "General";

/// The options of every command.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct GeneralOptions {
    /// Print more messages: -v what is done, -vv every detail
    #[arg(short, long, action = ArgAction::Count, global = true, help_heading = GENERAL)]
    verbose: u8,

    /// Number of threads to compute with [default: all cores]
    #[arg(
        long,
        global = true,
        value_name = "N",
        value_parser = values::threads,
        allow_hyphen_values = true,
        help_heading = GENERAL
    )]
    threads: Option<usize>,
}

impl GeneralOptions {
    /// Starts messages on standard error and the pool of threads; `quiet_filter` is the filter without `-v`. From then on
    /// a limit on the size of files is an error of the write.
    ///
    /// # Errors
    /// The threads cannot be started.
    pub fn start(&self, quiet_filter: &str) -> anyhow::Result<()> {
        let filter = match self.verbose {
            0 => quiet_filter,
            1 => "info",
            _ => "debug",
        };
        let (filter, refused) = match std::env::var("GRIM_LOG").map(|own| EnvFilter::try_new(&own))
        {
            Ok(Ok(own)) => (own, None),
            Ok(Err(error)) => (EnvFilter::new(filter), Some(error)),
            Err(_) => (EnvFilter::new(filter), None),
        };
        tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_writer(std::io::stderr)
            .with_ansi(terminal::has_colours(&std::io::stderr()))
            .without_time()
            .with_target(false)
            // `tracing-subscriber` escapes what could steer the terminal in messages, and not in the values beside them.
            .fmt_fields(
                format::debug_fn(|writer, field, value| {
                    let text = format!("{value:?}");
                    let text = printable_text(&text);
                    match field.name() {
                        "message" => write!(writer, "{text}"),
                        name => write!(writer, "{name}={text}"),
                    }
                })
                .delimited(" "),
            )
            // Whoever reads the messages may go away (`2>&1 | head`), and the work go on.
            .log_internal_errors(false)
            .init();
        if let Some(error) = refused {
            tracing::warn!("GRIM_LOG is not used: {error}; expected a filter such as `debug`");
        }
        file_size::report_limit_as_error()?;
        if let Some(threads) = self.threads {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build_global()?;
        }
        Ok(())
    }
}
