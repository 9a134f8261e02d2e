//! How many inputs the fuzz tests of this workspace try (CONTRIBUTING.md, "Fuzzing").

use proptest::test_runner::Config;

/// `cases` inputs of each test in a normal run, and what the variable `PROPTEST_CASES` says in a long one. Failures are printed, not
/// kept in files.
#[must_use]
pub fn config(cases: u32) -> Config {
    let default = Config::default();
    let is_long_run = std::env::var_os("PROPTEST_CASES").is_some();
    Config {
        cases: if is_long_run { default.cases } else { cases },
        failure_persistence: None,
        ..default
    }
}
