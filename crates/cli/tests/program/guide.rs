//! The commands of the user guide (`docs/`), run in the order of its chapters, in one folder, on the demo's files.
//!
//! A block of commands says after its language what becomes of it: `run` with the exit status that is expected (`run exit=2`; 0 if
//! nothing is said), `provided="..."` for what the tests have made already, or `skip="..."` with the reason.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use super::demo;

/// What becomes of a block of commands.
#[derive(Debug, PartialEq)]
enum Plan {
    Run { status: i32 },
    Left,
}

struct Block {
    chapter: String,
    line: usize,
    plan: Plan,
    commands: String,
}

pub fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs")
}

/// The chapters in the order of the index, each once.
fn chapters() -> Vec<String> {
    let mut names = Vec::new();
    for name in links(&fs::read_to_string(docs().join("README.md")).unwrap()) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

/// The addresses of a page's links, but for those into the web.
fn links(text: &str) -> Vec<String> {
    let targets = text.split("](").skip(1);
    targets
        .filter_map(|rest| rest.split(')').next())
        .filter(|target| !target.starts_with("http"))
        .map(|target| target.split('#').next().unwrap().to_owned())
        .filter(|target| !target.is_empty())
        .collect()
}

/// The plan that the words after a language state.
fn plan(words: &str) -> Option<Plan> {
    let reason = |key: &str| {
        let quoted = words.strip_prefix(key)?.strip_prefix("=\"")?;
        (quoted.strip_suffix('"')?.len() > 3).then_some(Plan::Left)
    };
    match words.strip_prefix("run") {
        Some("") => Some(Plan::Run { status: 0 }),
        Some(rest) => {
            let status = rest.strip_prefix(" exit=")?.parse().ok()?;
            Some(Plan::Run { status })
        }
        None => reason("skip").or_else(|| reason("provided")),
    }
}

/// The blocks of commands of a page.
fn blocks(chapter: &str, text: &str) -> Vec<Block> {
    let mut found = Vec::new();
    let mut open: Option<Option<Block>> = None;
    for (number, line) in text.lines().enumerate() {
        match (line.strip_prefix("```"), &mut open) {
            (Some(_), Some(_)) => found.extend(open.take().flatten()),
            (Some(info), None) => {
                let (language, words) = info.split_once(' ').unwrap_or((info, ""));
                assert!(
                    ["sh", "text", "python"].contains(&language),
                    "docs/{chapter}:{}: a block of {language:?}",
                    number + 1
                );
                open = Some((language == "sh").then(|| Block {
                    chapter: chapter.to_owned(),
                    line: number + 1,
                    plan: plan(words).unwrap_or_else(|| {
                        panic!(
                            "docs/{chapter}:{}: {words:?} is no plan for a block",
                            number + 1
                        )
                    }),
                    commands: String::new(),
                }));
            }
            (None, Some(Some(block))) => {
                block.commands.push_str(line);
                block.commands.push('\n');
            }
            (None, _) => {}
        }
    }
    assert!(open.is_none(), "docs/{chapter}: a block is not closed");
    found
}

#[test]
fn every_page_is_in_the_index_and_every_link_leads_somewhere() {
    let pages: BTreeSet<String> = fs::read_dir(docs())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".md") && name != "README.md")
        .collect();
    assert_eq!(pages, chapters().into_iter().collect::<BTreeSet<_>>());
    for page in pages.iter().map(String::as_str).chain(["README.md"]) {
        let text = fs::read_to_string(docs().join(page)).unwrap();
        for link in links(&text) {
            assert!(docs().join(&link).exists(), "docs/{page}: {link}");
        }
    }
}

#[test]
fn plans_are_understood_or_refused() {
    assert_eq!(plan("run"), Some(Plan::Run { status: 0 }));
    assert_eq!(plan("run exit=2"), Some(Plan::Run { status: 2 }));
    assert_eq!(plan("skip=\"needs an autopilot\""), Some(Plan::Left));
    for bad in ["", "runs", "run exit=", "skip", "skip=\"\"", "provided"] {
        assert_eq!(plan(bad), None, "{bad}");
    }
}

#[test]
#[cfg(unix)]
fn the_commands_run() {
    let folder = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink(demo(), folder.path().join("demo")).unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_grim"));
    let path = format!(
        "{}:{}",
        program.parent().unwrap().display(),
        std::env::var("PATH").unwrap()
    );
    let mut run = 0;
    for chapter in chapters() {
        let text = fs::read_to_string(docs().join(&chapter)).unwrap();
        for block in blocks(&chapter, &text) {
            let Plan::Run { status } = block.plan else {
                continue;
            };
            let output = std::process::Command::new("bash")
                .args(["-e", "-u", "-o", "pipefail", "-c", &block.commands])
                .current_dir(folder.path())
                .env("PATH", &path)
                .output()
                .unwrap();
            assert_eq!(
                output.status.code(),
                Some(status),
                "docs/{}:{}\n{}{}",
                block.chapter,
                block.line,
                block.commands,
                String::from_utf8_lossy(&output.stderr)
            );
            run += 1;
        }
    }
    assert!(run >= 15, "{run} blocks were run");
}
