//! The table that an experiment fills: rows and columns as in the paper, conditions, notes; as JSON, CSV and Markdown.
//!
//! One file an experiment, `<id>.json`:
//! ```json
//! {
//!   "id": "top-k",
//!   "title": "Error and time for K candidates",
//!   "paper_table": 6,
//!   "columns": [{ "name": "world 1", "unit": "m", "decimals": 2 }],
//!   "rows": [{ "name": "K = 5", "values": [4.33] }],
//!   "paper": [{ "name": "K = 5", "values": [4.33] }],
//!   "conditions": { "data": "5 procedural worlds", "model": "ab12..." },
//!   "notes": ["..."]
//! }
//! ```
//! A value is a number or `null`: not measured, or not defined (an average over no fixes). `paper` holds the paper's own figures
//! if they can be compared with these rows, with the columns named in `paper_columns`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use grimnet_output::{OutputError, OutputFolder};
use serde::{Deserialize, Serialize};

/// A column of figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// Unit of its values, such as `m`, `s`, `%`; empty for counts.
    pub unit: String,
    /// Digits after the point in print.
    pub decimals: usize,
}

impl Column {
    /// A column of metres.
    pub fn metres(name: impl Into<String>) -> Self {
        Self::new(name, "m", 2)
    }

    /// A column of seconds.
    pub fn seconds(name: impl Into<String>) -> Self {
        Self::new(name, "s", 3)
    }

    /// A column of shares in percent.
    pub fn percent(name: impl Into<String>) -> Self {
        Self::new(name, "%", 1)
    }

    /// A column of any unit.
    pub fn new(name: impl Into<String>, unit: &str, decimals: usize) -> Self {
        Self {
            name: name.into(),
            unit: unit.to_owned(),
            decimals,
        }
    }

    pub(crate) fn head(&self) -> String {
        if self.unit.is_empty() {
            self.name.clone()
        } else {
            format!("{}, {}", self.name, self.unit)
        }
    }

    pub(crate) fn print(&self, value: Option<f64>) -> String {
        value.map_or_else(|| "-".to_owned(), |v| format!("{v:.*}", self.decimals))
    }
}

/// A row of figures, one for each column.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What was varied, in the paper's words where possible.
    pub name: String,
    /// The figures.
    pub values: Vec<Option<f64>>,
}

impl Row {
    /// A row.
    pub fn new(name: impl Into<String>, values: Vec<Option<f64>>) -> Self {
        Self {
            name: name.into(),
            values,
        }
    }
}

/// A curve beside a table.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// Name of its file, beside the table's.
    pub file: String,
    /// What it shows.
    pub title: String,
    /// The picture; empty if the table was read from a file.
    #[serde(skip)]
    pub svg: String,
}

/// What an experiment measured.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ExperimentTable {
    /// Name of the experiment, and of its files.
    pub id: String,
    /// What the table shows.
    pub title: String,
    /// Number of the paper's table, if there is one.
    pub paper_table: Option<u32>,
    /// The columns.
    pub columns: Vec<Column>,
    /// The rows.
    pub rows: Vec<Row>,
    /// Columns of `paper`.
    #[serde(default)]
    pub paper_columns: Vec<Column>,
    /// The paper's own figures.
    #[serde(default)]
    pub paper: Vec<Row>,
    /// What it was measured on and with: data, frames, mode, model, version, machine.
    #[serde(default)]
    pub conditions: BTreeMap<String, String>,
    /// What a reader must know to read it.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Curves, each in a file of its own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub figures: Vec<Figure>,
    /// A maintainer's comparison with the paper's figures. It is kept when a new measurement replaces an old one, and must then be
    /// checked.
    #[serde(default)]
    pub discussion: String,
}

/// Why a table cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// A file cannot be read.
    #[error("cannot read the table: {0}")]
    Io(#[from] std::io::Error),
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The file is no table.
    #[error("{path}: not a table of an experiment: {source}")]
    Json {
        /// The file.
        path: std::path::PathBuf,
        /// What the reader said.
        source: serde_json::Error,
    },
    /// The table cannot be put into CSV.
    #[error("cannot write the table as CSV: {0}")]
    Csv(#[from] csv::Error),
}

/// The files of the table of this name: JSON, CSV and Markdown. Figures have files of their own.
#[must_use]
pub fn file_names(id: &str) -> [String; 3] {
    ["json", "csv", "md"].map(|ending| format!("{id}.{ending}"))
}

impl ExperimentTable {
    /// Writes [`file_names`] and the figures into a folder. A table without a discussion keeps that of the one it replaces.
    ///
    /// # Errors
    /// A file cannot be written, or one of its name is not the program's own.
    pub fn write(&self, folder: &OutputFolder) -> Result<(), TableError> {
        let [json, csv, markdown] = file_names(&self.id);
        let path = folder.path().join(&json);
        let mut table = self.clone();
        if table.discussion.is_empty() && path.is_file() {
            table.discussion = Self::read(&path)?.discussion;
        }
        let text = serde_json::to_string_pretty(&table)
            .map_err(|source| TableError::Json { path, source })?;
        folder.write_bytes(&json, (text + "\n").as_bytes())?;
        for figure in table.figures.iter().filter(|f| !f.svg.is_empty()) {
            folder.write_bytes(&figure.file, figure.svg.as_bytes())?;
        }
        folder.write_bytes(&csv, table.to_csv()?.as_bytes())?;
        folder.write_bytes(&markdown, table.to_markdown("").as_bytes())?;
        Ok(())
    }

    /// Reads what [`ExperimentTable::write`] wrote as JSON.
    ///
    /// # Errors
    /// The file cannot be read or is no table.
    pub fn read(path: &Path) -> Result<Self, TableError> {
        let text = fs_err::read(path)?;
        serde_json::from_slice(&text).map_err(|source| TableError::Json {
            path: path.to_owned(),
            source,
        })
    }

    /// As CSV: a header, a line a row, values in full precision.
    ///
    /// # Errors
    /// Rows of unequal length.
    pub fn to_csv(&self) -> Result<String, TableError> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let heads = self.columns.iter().map(Column::head);
        writer.write_record(std::iter::once(String::new()).chain(heads))?;
        for row in &self.rows {
            let cells = row
                .values
                .iter()
                .map(|v| v.map(|v| v.to_string()).unwrap_or_default());
            writer.write_record(std::iter::once(row.name.clone()).chain(cells))?;
        }
        let bytes = writer
            .into_inner()
            .map_err(|e| TableError::Io(e.into_error()))?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// As Markdown: title, table, the paper's figures beside it, curves, notes, conditions. `prefix` leads to the folder of the
    /// curves.
    #[must_use]
    pub fn to_markdown(&self, prefix: &str) -> String {
        let mut text = format!("### {}", self.title);
        if let Some(number) = self.paper_table {
            // Writing to a string cannot fail, here and below.
            let _ = write!(text, " (the paper's table {number})");
        }
        text.push_str("\n\n");
        text.push_str(&markdown(&self.columns, &self.rows));
        if !self.paper.is_empty() {
            text.push_str("\nThe paper, on its own scenes:\n\n");
            text.push_str(&markdown(&self.paper_columns, &self.paper));
        }
        for Figure { file, title, .. } in &self.figures {
            let _ = write!(text, "\n![{title}]({prefix}{file})\n");
        }
        for note in &self.notes {
            let _ = write!(text, "\n{note}\n");
        }
        if !self.discussion.is_empty() {
            let _ = write!(text, "\n{}\n", self.discussion);
        }
        if !self.conditions.is_empty() {
            let all: Vec<String> = self
                .conditions
                .iter()
                .map(|(k, v)| format!("{k}: {v}"))
                .collect();
            let _ = write!(text, "\n*{}.*\n", all.join("; "));
        }
        text
    }
}

fn markdown(columns: &[Column], rows: &[Row]) -> String {
    let mut text = String::from("| |");
    for column in columns {
        let _ = write!(text, " {} |", column.head());
    }
    text.push_str("\n|---|");
    text.push_str(&"---:|".repeat(columns.len()));
    text.push('\n');
    for row in rows {
        let _ = write!(text, "| {} |", row.name);
        for (column, value) in columns.iter().zip(&row.values) {
            let _ = write!(text, " {} |", column.print(*value));
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_output::OutputPolicy;

    fn table() -> ExperimentTable {
        ExperimentTable {
            id: "top-k".into(),
            title: "Error and time for K candidates".into(),
            paper_table: Some(6),
            columns: vec![Column::metres("world 1"), Column::seconds("average time")],
            rows: vec![
                Row::new("K = 1", vec![Some(9.2149), Some(0.18)]),
                Row::new("K = 5", vec![None, Some(0.4)]),
            ],
            paper_columns: vec![Column::metres("Museum")],
            paper: vec![Row::new("K = 1", vec![Some(19.86)])],
            conditions: [("data".to_owned(), "1 world".to_owned())].into(),
            notes: vec!["A dash: no fix.".into()],
            figures: vec![Figure {
                file: "top-k-errors.svg".into(),
                title: "Errors".into(),
                svg: String::new(),
            }],
            discussion: String::new(),
        }
    }

    fn open(folder: &tempfile::TempDir) -> OutputFolder {
        OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap()
    }

    #[test]
    fn a_file_of_others_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let notes = folder.path().join("top-k.md");
        fs_err::write(&notes, "my notes").unwrap();
        let error = table().write(&open(&folder)).unwrap_err();
        assert!(error.to_string().contains("top-k.md"), "{error}");
        assert_eq!(fs_err::read_to_string(&notes).unwrap(), "my notes");
    }

    #[test]
    fn a_new_measurement_keeps_the_discussion() {
        let folder = tempfile::tempdir().unwrap();
        let discussed = ExperimentTable {
            discussion: "As in the paper.".into(),
            ..table()
        };
        discussed.write(&open(&folder)).unwrap();
        table().write(&open(&folder)).unwrap();
        let kept = ExperimentTable::read(&folder.path().join("top-k.json")).unwrap();
        assert_eq!(kept.discussion, "As in the paper.");
        assert!(kept.to_markdown("").contains("\nAs in the paper.\n"));
    }

    #[test]
    fn all_three_forms_say_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let table = table();
        table.write(&open(&folder)).unwrap();
        assert_eq!(
            ExperimentTable::read(&folder.path().join("top-k.json")).unwrap(),
            table
        );
        let csv = fs_err::read_to_string(folder.path().join("top-k.csv")).unwrap();
        assert_eq!(
            csv,
            ",\"world 1, m\",\"average time, s\"\nK = 1,9.2149,0.18\nK = 5,,0.4\n"
        );
        let markdown = fs_err::read_to_string(folder.path().join("top-k.md")).unwrap();
        let in_page = table.to_markdown("figures/");
        assert!(
            in_page.contains("![Errors](figures/top-k-errors.svg)"),
            "{in_page}"
        );
        for part in [
            "(the paper's table 6)",
            "| | world 1, m | average time, s |",
            "| K = 1 | 9.21 | 0.180 |",
            "| K = 5 | - | 0.400 |",
            "| K = 1 | 19.86 |",
            "A dash: no fix.",
            "*data: 1 world.*",
        ] {
            assert!(markdown.contains(part), "{part} in\n{markdown}");
        }
    }

    #[test]
    fn a_file_that_is_no_table_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.json");
        fs_err::write(&path, "[]").unwrap();
        assert!(
            ExperimentTable::read(&path)
                .unwrap_err()
                .to_string()
                .contains("x.json")
        );
    }
}
