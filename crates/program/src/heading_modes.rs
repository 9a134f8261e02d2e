//! The option `--heading` of evaluations: what the localiser is given of headings.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use grimnet_eval::scene::HeadingMode;

/// A value of the option: its name, its help, and the modes that are evaluated one after the other.
type Choice = (&'static str, &'static str, &'static [HeadingMode]);

const CHOICES: [Choice; 4] = [
    (
        BOTH,
        "Both ways, one after the other",
        &[HeadingMode::Known, HeadingMode::Unknown],
    ),
    ("known", "From the truth file", &[HeadingMode::Known]),
    (
        "unknown",
        "None: the heading is searched",
        &[HeadingMode::Unknown],
    ),
    (
        "exif",
        "From the photos' metadata",
        &[HeadingMode::FromPhoto],
    ),
];

/// The option's default.
pub const BOTH: &str = "both";

/// Parses the option to the modes that it names.
pub fn heading_modes() -> impl TypedValueParser<Value = &'static [HeadingMode]> {
    let names = CHOICES.map(|(name, help, _)| PossibleValue::new(name).help(help));
    PossibleValuesParser::new(names).map(|text| {
        let named = CHOICES.iter().find(|(name, ..)| *name == text);
        named.map_or(&[] as &[HeadingMode], |(.., modes)| modes)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_value_names_its_modes() {
        let command = clap::Command::new("grim").arg(
            clap::Arg::new("heading")
                .long("heading")
                .value_parser(heading_modes()),
        );
        for (name, _, modes) in CHOICES {
            let given = command
                .clone()
                .try_get_matches_from(["grim", "--heading", name])
                .unwrap();
            let parsed: &&[HeadingMode] = given.get_one("heading").unwrap();
            assert_eq!(*parsed, modes, "{name}");
            assert!(!modes.is_empty());
        }
        assert!(
            command
                .try_get_matches_from(["grim", "--heading", "north"])
                .is_err()
        );
    }
}
