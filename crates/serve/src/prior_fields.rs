//! What a request says about its photo, as JSON or as query parameters.

use grimnet_locate::{HeadingPrior, Near, Prior, ViewPrior};
use serde::Deserialize;

use crate::problem::Problem;
use crate::request_body::of_json;

/// What is known of the photo. What is left out comes from its metadata, or is searched.
#[derive(Debug, Clone, Default, Deserialize, utoipa::ToSchema, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[schema(as = Prior)]
#[into_params(parameter_in = Query)]
pub(crate) struct PriorFields {
    /// Direction of the photo's top edge: degrees clockwise from true north, `exif` (from the metadata, searched if they do not
    /// hold it; the default) or `unknown` (searched).
    #[param(value_type = Option<String>)]
    heading: Option<HeadingField>,
    /// Standard deviation of a heading in degrees; 5 by default.
    heading_sigma_deg: Option<f64>,
    /// Pitch of the camera, degrees: -90 looks straight down, -60 towards the photo's top by 30 degrees.
    pitch_deg: Option<f64>,
    /// Height above ground, metres.
    height_agl_m: Option<f64>,
    /// Horizontal field of view, degrees.
    hfov_deg: Option<f64>,
    /// Ground resolution of the full-size photo, metres per pixel; excludes height and field of view.
    gsd_m: Option<f64>,
    /// Search only here: latitude and longitude in degrees, radius in metres. As a query parameter: `LAT,LON,RADIUS_M`.
    #[param(value_type = Option<String>)]
    near: Option<NearField>,
}

/// A heading in degrees, or a word.
#[derive(Debug, Clone, Deserialize, utoipa::ToSchema)]
#[serde(
    untagged,
    expecting = "expected degrees clockwise from north (-720 to 720), `exif` or `unknown`"
)]
#[schema(as = Heading)]
enum HeadingField {
    Degrees(f64),
    Text(String),
}

/// An area, as an object or as text.
#[derive(Debug, Clone, Deserialize, utoipa::ToSchema)]
#[serde(
    untagged,
    expecting = "expected `LAT,LON,RADIUS_M`, such as 24.26,120.72,500, or in JSON an object of `lat_deg`, `lon_deg` and `radius_m`"
)]
#[schema(as = Near)]
enum NearField {
    Area(Area),
    Text(String),
}

/// A circle on the ground that contains the photo's centre.
#[derive(Debug, Clone, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
struct Area {
    /// Latitude of the centre, degrees.
    lat_deg: f64,
    /// Longitude of the centre, degrees.
    lon_deg: f64,
    /// Radius, metres.
    radius_m: f64,
}

impl PriorFields {
    /// The fields of a JSON text; `null` says nothing, as the OpenAPI document has it.
    ///
    /// # Errors
    /// Status 400 if it is no JSON object of these fields.
    pub(crate) fn from_json(json: &[u8]) -> Result<Self, Problem> {
        of_json(json)
            .map(Option::unwrap_or_default)
            .map_err(|error| Problem::bad_request(format!("the prior is not understood: {error}")))
    }

    /// The fields that are given as query parameters.
    ///
    /// # Errors
    /// Status 400 for an unknown or repeated parameter, or a text where a number is expected.
    pub(crate) fn from_pairs(pairs: &[(String, String)]) -> Result<Self, Problem> {
        let mut object = serde_json::Map::new();
        for (name, text) in pairs {
            let number = text
                .parse::<f64>()
                .ok()
                .and_then(serde_json::Number::from_f64);
            let value = match number {
                Some(number) => number.into(),
                None => text.as_str().into(),
            };
            if object.insert(name.clone(), value).is_some() {
                return Err(Problem::bad_request(format!("{name} is given twice")));
            }
        }
        serde_path_to_error::deserialize(serde_json::Value::from(object))
            .map_err(|error| Problem::bad_request(format!("the query is not understood: {error}")))
    }

    /// The prior of the localiser.
    ///
    /// # Errors
    /// Status 422 for values out of range and for those that contradict each other.
    pub(crate) fn prior(&self) -> Result<Prior, Problem> {
        if self.gsd_m.is_some() && (self.height_agl_m.is_some() || self.hfov_deg.is_some()) {
            return Err(Problem::bad_value(
                "gsd_m is given together with height_agl_m or hfov_deg; expected either the ground resolution or what it follows from",
            ));
        }
        let prior = Prior {
            view: ViewPrior {
                heading: self.heading()?,
                pitch_deg: self.pitch_deg,
                roll_deg: None,
                height_agl_m: self.height_agl_m,
                hfov_deg: self.hfov_deg,
                gsd_m: self.gsd_m,
            },
            near: self.near()?,
        };
        // Here, so that a frame with a wrong value never reaches its track.
        prior.check().map_err(Problem::bad_value)?;
        Ok(prior)
    }

    fn heading(&self) -> Result<HeadingPrior, Problem> {
        let text = match &self.heading {
            None => "exif".to_owned(),
            Some(HeadingField::Degrees(degrees)) => degrees.to_string(),
            Some(HeadingField::Text(text)) => text.clone(),
        };
        let heading: HeadingPrior = text
            .parse()
            .map_err(|expected| Problem::bad_value(format!("heading is {text:?}; {expected}")))?;
        heading
            .with_sigma_deg(self.heading_sigma_deg)
            .map_err(Problem::bad_value)
    }

    fn near(&self) -> Result<Option<Near>, Problem> {
        let text = match &self.near {
            None => return Ok(None),
            Some(NearField::Area(area)) => {
                format!("{},{},{}", area.lat_deg, area.lon_deg, area.radius_m)
            }
            Some(NearField::Text(text)) => text.clone(),
        };
        let near: Result<Near, String> = text.parse();
        near.map(Some)
            .map_err(|expected| Problem::bad_value(format!("near is {text:?}; {expected}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn json(text: &str) -> Result<Prior, Problem> {
        PriorFields::from_json(text.as_bytes())?.prior()
    }

    fn query(pairs: &[(&str, &str)]) -> Result<Prior, Problem> {
        let pairs: Vec<_> = pairs
            .iter()
            .map(|&(name, text)| (name.to_owned(), text.to_owned()))
            .collect();
        PriorFields::from_pairs(&pairs)?.prior()
    }

    #[test]
    fn json_and_query_say_the_same() {
        let from_json = json(
            r#"{"heading": -146, "heading_sigma_deg": 3, "pitch_deg": -60, "height_agl_m": 118, "hfov_deg": 73.5,
                "near": {"lat_deg": 24.26, "lon_deg": 120.72, "radius_m": 500}}"#,
        )
        .unwrap();
        let from_query = query(&[
            ("heading", "-146"),
            ("heading_sigma_deg", "3"),
            ("pitch_deg", "-60"),
            ("height_agl_m", "118"),
            ("hfov_deg", "73.5"),
            ("near", "24.26,120.72,500"),
        ])
        .unwrap();
        assert_eq!(from_json, from_query);
        let centre = from_json.near.unwrap().centre;
        assert_eq!([centre.lat_deg, centre.lon_deg], [24.26, 120.72]);
        assert_eq!(
            from_json.view.heading,
            HeadingPrior::Known {
                heading_deg: 214.0,
                sigma_deg: 3.0
            }
        );
        assert_eq!(json("{}").unwrap(), Prior::none());
        assert_eq!(json("null").unwrap(), Prior::none());
        assert_eq!(
            query(&[("heading", "unknown")]).unwrap().view.heading,
            HeadingPrior::Unknown
        );
    }

    #[test]
    fn what_was_expected_is_said() {
        for (refused, expected) in [
            (query(&[("near", "5")]), "near: expected `LAT,LON,RADIUS_M`"),
            (
                json(r#"{"near": {"lat_deg": 20, "lon_deg": 24}}"#),
                "an object of `lat_deg`, `lon_deg` and `radius_m`",
            ),
            (
                json(r#"{"heading": [1]}"#),
                "heading: expected degrees clockwise from north (-720 to 720), `exif` or `unknown`",
            ),
            (query(&[("hedding", "5")]), "`hedding`"),
            (
                query(&[("height_agl_m", "118m")]),
                r#"height_agl_m: invalid type: string \"118m\""#,
            ),
            (
                json(r#"{"heading": 12, "hfov_deg": "73"}"#),
                r#"hfov_deg: invalid type: string \"73\""#,
            ),
        ] {
            let problem = format!("{:?}", refused.unwrap_err());
            assert!(problem.contains(expected), "{problem}");
        }
    }

    #[test]
    fn what_is_not_understood_or_out_of_range_is_refused() {
        for bad in [
            "",
            "[]",
            "nonsense",
            r#"{"altitude": 3}"#,
            r#"{"heading": "north"}"#,
            r#"{"heading": [1]}"#,
            r#"{"heading": 1e308}"#,
            r#"{"heading_sigma_deg": 3}"#,
            r#"{"heading": 3, "heading_sigma_deg": 0}"#,
            r#"{"hfov_deg": 180}"#,
            r#"{"hfov_deg": "wide"}"#,
            r#"{"hfov_deg": 170}"#,
            r#"{"pitch_deg": 30}"#,
            r#"{"height_agl_m": -1}"#,
            r#"{"height_agl_m": 30000}"#,
            r#"{"gsd_m": 0.1, "height_agl_m": 100}"#,
            r#"{"near": {"lat_deg": 120.72, "lon_deg": 24.26, "radius_m": 500}}"#,
            r#"{"near": {"lat_deg": 20, "lon_deg": 24}}"#,
            r#"{"near": "here"}"#,
        ] {
            assert!(json(bad).is_err(), "{bad}");
        }
        for bad in [
            [("height_agl_m", "nan"), ("hfov_deg", "70")],
            [("height_agl_m", "inf"), ("hfov_deg", "70")],
            [("height_agl_m", "100"), ("height_agl_m", "100")],
            [("photo", "/etc/passwd"), ("hfov_deg", "70")],
        ] {
            assert!(query(&bad).is_err(), "{bad:?}");
        }
    }
}
