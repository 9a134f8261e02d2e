//! Every test that `README.md` names exists.

use std::path::Path;

#[test]
fn the_list_of_faults_names_tests_that_exist() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let list = crates.join("cli/tests/program/faults/README.md");
    let list = std::fs::read_to_string(list).unwrap();
    let rows: Vec<&str> = list.lines().filter(|line| line.starts_with("| ")).collect();
    let mut count = 0;
    for row in rows {
        let [_, fault, answer, tests, _] = row.split('|').collect::<Vec<_>>()[..] else {
            panic!("{row}");
        };
        if fault.trim() == "fault" {
            continue;
        }
        assert!(answer.trim().len() > 3, "{row}");
        for test in tests.split(',') {
            let test = test.trim().trim_matches('`');
            let (file, name) = test.split_once("::").unwrap_or_else(|| panic!("{row}"));
            let text = std::fs::read_to_string(crates.join(file)).unwrap_or_default();
            assert!(
                text.contains(&format!("fn {name}(")),
                "{test} does not exist"
            );
            count += 1;
        }
    }
    assert!(count > 70, "{count}");
}
