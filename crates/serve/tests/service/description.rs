//! What the service sends is what `/openapi.json` describes.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Value, json};

use crate::area::{FLIGHT_STEP_S, area, shared};
use crate::client::{Answer, get, send};

const PHOTO: &str = "content-type: image/jpeg";

/// Endings of names, and a word of the unit that the description then has.
const UNITS: [(&str, &str); 7] = [
    ("_deg", "degrees"),
    ("_m", "metres"),
    ("_m2", "square metres"),
    ("_m_s", "metres per second"),
    ("_s", "seconds"),
    ("_ms", "milliseconds"),
    ("_px", "pixels"),
];

/// The OpenAPI document, and which of its fields were sent.
struct Description {
    document: Value,
    /// By schema: names that were sent.
    sent: BTreeMap<String, BTreeSet<String>>,
}

impl Description {
    fn read() -> Self {
        Self {
            document: get(shared(), "/openapi.json").json(),
            sent: BTreeMap::new(),
        }
    }

    /// The schema of what an operation answers with a status.
    fn answered(&self, method: &str, path: &str, status: &str, media_type: &str) -> Value {
        let operation = &self.document["paths"][path][method];
        let content = &operation["responses"][status]["content"][media_type];
        let schema = content["schema"].clone();
        assert!(
            schema.is_object(),
            "{method} {path} {status} {media_type}: {operation}"
        );
        schema
    }

    /// Checks a value that was sent against its schema: each field is described, with its unit, and none is missing.
    fn check(&mut self, schema: &Value, value: &Value, at: &str) {
        if let Some(reference) = schema["$ref"].as_str() {
            let pointer = reference.strip_prefix('#').unwrap();
            let schema = self.document.pointer(pointer).unwrap().clone();
            let name = reference.rsplit('/').next().unwrap();
            self.check(&schema, value, name);
            return;
        }
        if value.is_object()
            && let Some(all) = schema.get("oneOf").or(schema.get("anyOf"))
        {
            // An object or null.
            let all = all.as_array().unwrap();
            let one = all.iter().find(|each| each["$ref"].is_string()).unwrap();
            self.check(&one.clone(), value, at);
            return;
        }
        match value {
            Value::Null => {
                let text = schema.to_string();
                assert!(text.contains("\"null\""), "{at} is null: {schema}");
            }
            Value::Array(list) => {
                let items = self.alternative(schema, "array")["items"].clone();
                for each in list {
                    self.check(&items, each, at);
                }
            }
            Value::Object(object) => self.check_object(schema, object, at),
            Value::String(_) => drop(self.alternative(schema, "string")),
            Value::Bool(_) => drop(self.alternative(schema, "boolean")),
            Value::Number(number) if number.is_f64() => drop(self.alternative(schema, "number")),
            Value::Number(_) => {
                let types = self.types(schema);
                let is_number = types.contains("integer") || types.contains("number");
                assert!(is_number, "{at}: {schema}");
            }
        }
    }

    fn check_object(&mut self, schema: &Value, object: &serde_json::Map<String, Value>, at: &str) {
        let schema = self.alternative(schema, "object");
        let (fields, required) = self.fields(&schema);
        if fields.is_empty() {
            let values = &schema["additionalProperties"];
            assert!(values.is_object(), "{at} has no fields: {schema}");
            for (name, value) in object {
                self.check(&values.clone(), value, &format!("{at}.{name}"));
            }
            return;
        }
        for (name, value) in object {
            let at = format!("{at}.{name}");
            let field = fields.get(name);
            let field = field.unwrap_or_else(|| panic!("{at} is not described"));
            let description = self.words(field);
            assert!(!description.is_empty(), "{at} has no words: {field}");
            let unit = UNITS
                .iter()
                .filter(|(ending, _)| name.trim_end_matches("95").ends_with(ending))
                .max_by_key(|(ending, _)| ending.len());
            if let Some((_, unit)) = unit {
                let has_unit = description.to_lowercase().contains(unit);
                assert!(has_unit, "{at} in {unit}: {description}");
            }
            self.check(field, value, &at);
        }
        for name in required {
            assert!(object.contains_key(&name), "{at}.{name} is not sent");
        }
        let sent = self.sent.entry(at.to_owned()).or_default();
        sent.extend(object.keys().cloned());
    }

    /// The alternative of a schema that is of a type; the schema itself if it has no alternatives.
    fn alternative(&self, schema: &Value, of_type: &str) -> Value {
        let found = self
            .alternatives(schema)
            .into_iter()
            .find(|each| self.types(each).contains(of_type));
        found.unwrap_or_else(|| panic!("no {of_type}: {schema}"))
    }

    fn alternatives(&self, schema: &Value) -> Vec<Value> {
        let schema = match schema["$ref"].as_str() {
            Some(reference) => self.document.pointer(&reference[1..]).unwrap(),
            None => schema,
        };
        match schema.get("oneOf").or(schema.get("anyOf")) {
            Some(all) => {
                let all = all.as_array().unwrap();
                all.iter()
                    .flat_map(|each| self.alternatives(each))
                    .collect()
            }
            None => vec![schema.clone()],
        }
    }

    fn types(&self, schema: &Value) -> BTreeSet<String> {
        let text = |value: &Value| value.as_str().unwrap().to_owned();
        match (&schema["type"], schema.get("allOf")) {
            (Value::String(one), _) => [one.clone()].into(),
            (Value::Array(all), _) => all.iter().map(text).collect(),
            (_, Some(_)) => ["object".to_owned()].into(),
            _ => {
                let alternatives = self.alternatives(schema);
                let each = alternatives.iter().filter(|each| *each != schema);
                each.flat_map(|each| self.types(each)).collect()
            }
        }
    }

    /// The fields of an object, and those that it always has.
    fn fields(&self, schema: &Value) -> (BTreeMap<String, Value>, BTreeSet<String>) {
        let mut found = (BTreeMap::new(), BTreeSet::new());
        for part in schema["allOf"].as_array().into_iter().flatten() {
            let [part] = &self.alternatives(part)[..] else {
                panic!("{part}");
            };
            let (fields, required) = self.fields(part);
            found.0.extend(fields);
            found.1.extend(required);
        }
        if let Some(properties) = schema["properties"].as_object() {
            let fields = properties.iter();
            found
                .0
                .extend(fields.map(|(name, field)| (name.clone(), field.clone())));
        }
        let required = schema["required"].as_array().into_iter().flatten();
        let required = required.map(|name| name.as_str().unwrap().to_owned());
        found.1.extend(required);
        found
    }

    /// What is said of a field, there or where its type is described.
    fn words(&self, field: &Value) -> String {
        let own = field["description"].as_str().unwrap_or_default();
        let mut words = own.to_owned();
        for alternative in self.alternatives(field) {
            words += alternative["description"].as_str().unwrap_or_default();
        }
        words
    }

    /// Checks that each described field of a schema was sent once.
    fn check_all_sent(&self, schema: &str) {
        let (fields, _) = self.fields(&self.document["components"]["schemas"][schema]);
        let sent = self.sent.get(schema);
        let sent = sent.unwrap_or_else(|| panic!("{schema} is not among {:?}", self.sent.keys()));
        let never: Vec<_> = fields.keys().filter(|name| !sent.contains(*name)).collect();
        assert!(
            never.is_empty(),
            "{schema}: {never:?} is described and not sent"
        );
    }
}

/// Checks a good answer in JSON.
fn check(description: &mut Description, method: &str, path: &str, status: &str, answer: &Answer) {
    assert_eq!(answer.status.to_string(), status, "{}", answer.text());
    let media_type = answer.header("content-type").unwrap();
    let schema = description.answered(method, path, status, media_type);
    description.check(&schema, &answer.json(), path);
}

#[test]
fn what_is_sent_is_described() {
    let mut description = Description::read();
    let known = &mut description;
    let line = "POST /v1/locate?detail=true&name=a.jpg";
    let fix = send(shared(), line, &[PHOTO], &area().photo);
    assert_eq!(fix.json()["state"], "fix");
    check(known, "post", "/v1/locate", "200", &fix);
    let line = "POST /v1/locate?heading=unknown&near=1.0003,1.5003,1";
    let elsewhere = send(shared(), line, &[PHOTO], &area().photo);
    check(known, "post", "/v1/locate", "200", &elsewhere);
    let answers = json!([fix.json(), elsewhere.json()]).to_string();
    let headers = ["accept: application/json"];
    let list = send(shared(), "POST /v1/answers", &headers, answers.as_bytes());
    check(known, "post", "/v1/answers", "200", &list);

    let maps = get(shared(), "/v1/maps");
    check(known, "get", "/v1/maps", "200", &maps);
    let tilejson = get(shared(), "/v1/maps/area/tilejson.json");
    check(
        known,
        "get",
        "/v1/maps/{id}/tilejson.json",
        "200",
        &tilejson,
    );

    let begun = send(shared(), "POST /v1/tracks", &[], &[]);
    check(known, "post", "/v1/tracks", "201", &begun);
    let path = "/v1/tracks/{id}/frames";
    for (number, (photo, _)) in area().flight.iter().enumerate() {
        let time_s = number as f64 * FLIGHT_STEP_S;
        let line = format!(
            "POST /v1/tracks/{}/frames?time_s={time_s}",
            begun.json()["id"]
        );
        let frame = send(shared(), &line, &[PHOTO], photo);
        check(known, "post", path, "200", &frame);
        for field in ["searched", "state", "source", "position_of"] {
            let value = frame.json();
            let word = value.get(field).unwrap_or(&value["point"][field]).clone();
            let schema = if field == "searched" {
                "TrackFrame"
            } else {
                "TrackPoint"
            };
            let property = &known.document["components"]["schemas"][schema]["properties"][field];
            let listed = format!("`{}`", word.as_str().unwrap_or("null"));
            assert!(
                word.is_null() || known.words(property).contains(&listed),
                "{field}: {word}"
            );
        }
    }
    let tracks = get(shared(), "/v1/tracks");
    check(known, "get", "/v1/tracks", "200", &tracks);

    let problem = get(shared(), "/v1/tracks/x");
    let media_type = problem.header("content-type").unwrap();
    let schema = known.answered("get", "/v1/tracks/{id}", "default", media_type);
    known.check(&schema, &problem.json(), "problem");
    for schema in [
        "Answer",
        "Detail",
        "Evidence",
        "Map",
        "Level",
        "Problem",
        "TileJson",
        "Track",
        "TrackFrame",
        "TrackPoint",
    ] {
        known.check_all_sent(schema);
    }
}

#[test]
fn the_guide_lists_every_field_of_a_frame() {
    let description = Description::read();
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/service.md");
    let page = std::fs::read_to_string(page).unwrap();
    for schema in ["TrackFrame", "TrackPoint"] {
        let (fields, _) =
            description.fields(&description.document["components"]["schemas"][schema]);
        for name in fields.keys() {
            assert!(page.contains(&format!("`{name}`")), "{schema}.{name}");
        }
    }
}
