//! The query of an address.

use axum::http::Uri;

use crate::problem::Problem;

/// Names and values, decoded. What a handler takes is removed; the rest is what is known of a photo.
#[derive(Debug)]
pub(crate) struct Query(Vec<(String, String)>);

impl Query {
    /// The query of `uri`.
    ///
    /// # Errors
    /// Status 400 if it cannot be decoded.
    pub(crate) fn of(uri: &Uri) -> Result<Self, Problem> {
        axum::extract::Query::<Vec<(String, String)>>::try_from_uri(uri)
            .map(|axum::extract::Query(pairs)| Self(pairs))
            .map_err(|error| Problem::bad_request(format!("the query is malformed: {error}")))
    }

    /// Removes the value of `name`.
    ///
    /// # Errors
    /// Status 400 if it is given twice.
    pub(crate) fn take(&mut self, name: &str) -> Result<Option<String>, Problem> {
        let Some(at) = self.0.iter().position(|(given, _)| given == name) else {
            return Ok(None);
        };
        let (_, value) = self.0.remove(at);
        if self.0.iter().any(|(given, _)| given == name) {
            return Err(Problem::bad_request(format!("{name} is given twice")));
        }
        Ok(Some(value))
    }

    /// Removes the value of `name`, which is false if it is not given.
    ///
    /// # Errors
    /// Status 400 if it is neither `true` nor `false`, or given twice.
    pub(crate) fn take_bool(&mut self, name: &str) -> Result<bool, Problem> {
        match self.take(name)?.as_deref() {
            None | Some("false") => Ok(false),
            Some("true") => Ok(true),
            Some(other) => Err(Problem::bad_request(format!(
                "{name} is {other:?}; expected `true` or `false`"
            ))),
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(crate) fn pairs(&self) -> &[(String, String)] {
        &self.0
    }
}
