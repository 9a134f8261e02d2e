//! `grim serve`: the HTTP service.

mod arguments;
#[cfg(feature = "serve")]
mod session;

pub use arguments::{EXAMPLES, ServeArgs};

/// Runs the command.
///
/// # Errors
/// Unreadable pack, model or map; an address that cannot be listened on.
#[cfg(feature = "serve")]
pub fn run(arguments: &ServeArgs) -> anyhow::Result<crate::exit::Exit> {
    session::run(arguments)
}

/// Serves one pack with its map on this machine.
///
/// # Errors
/// As [`run`]. Also if other machines could reach the address.
#[cfg(feature = "serve")]
pub fn run_on_demo(
    model: super::ModelChoice,
    pack: &std::path::Path,
    map: &std::path::Path,
    address: std::net::SocketAddr,
) -> anyhow::Result<crate::exit::Exit> {
    session::run(&ServeArgs::of_demo(model, pack, map, address))
}

/// Checks that [`run_on_demo`] could listen now.
///
/// # Errors
/// The address cannot be listened on, or other machines could reach it.
#[cfg(feature = "serve")]
pub fn check_demo(address: std::net::SocketAddr) -> anyhow::Result<()> {
    session::check_address(address)
}

/// Says how to get the service.
///
/// # Errors
/// Always: this build has none.
#[cfg(not(feature = "serve"))]
pub fn check_demo(_: std::net::SocketAddr) -> anyhow::Result<()> {
    anyhow::bail!(super::absent::message("grim demo --serve", "serve"))
}

/// Says how to get the service.
///
/// # Errors
/// Always: this build has none.
#[cfg(not(feature = "serve"))]
pub fn run_on_demo(
    _: super::ModelChoice,
    _: &std::path::Path,
    _: &std::path::Path,
    _: std::net::SocketAddr,
) -> anyhow::Result<crate::exit::Exit> {
    anyhow::bail!(super::absent::message("grim demo --serve", "serve"))
}

/// Says how to get the service.
///
/// # Errors
/// Always: this build has none.
#[cfg(not(feature = "serve"))]
pub fn run(_: &ServeArgs) -> anyhow::Result<crate::exit::Exit> {
    anyhow::bail!(super::absent::message("grim serve", "serve"))
}
