//! The OpenAPI document of the service.

use axum::Json;
use axum::response::IntoResponse;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Components, Content, Ref, RefOr, ResponseBuilder, Schema};
use utoipa::{Modify, OpenApi};

use crate::problem;

/// The name of the token in the document.
const TOKEN: &str = "token";

/// Schemas whose fields are all sent, also where they are `null`. Derived, those that may be left out when they are read, or may be `null`,
/// would not be required, and clients that are made from the document would take each of them for one that may be missing.
const SENT_WHOLE: [&str; 4] = ["Answer", "Detail", "Track", "TrackFrame"];

/// A multipart body of `POST /v1/locate`, for the document.
#[derive(utoipa::ToSchema)]
#[allow(dead_code, reason = "describes a body")]
pub(crate) struct LocateForm {
    /// The photo file: JPEG, PNG, TIFF or WebP.
    #[schema(value_type = String, format = Binary)]
    photo: Vec<u8>,
    /// What is known of the photo.
    prior: Option<crate::prior_fields::PriorFields>,
}

/// The bytes of a file, for the document.
#[derive(utoipa::ToSchema)]
#[schema(value_type = String, format = Binary)]
#[allow(dead_code, reason = "describes a body")]
pub(crate) struct Binary(Vec<u8>);

/// A GeoJSON feature collection (RFC 7946), for the document.
#[derive(utoipa::ToSchema)]
#[schema(value_type = Object)]
#[allow(dead_code, reason = "describes a body")]
pub(crate) struct GeoJson(serde_json::Value);

#[derive(OpenApi)]
#[openapi(
    info(
        title = "grimnet",
        description = "Where on this map was this photo taken? Positions are WGS 84; errors are problem details (RFC 9457).",
        license(name = "MIT OR Apache-2.0")
    ),
    paths(
        crate::locate_route::locate,
        crate::answers_route::answers,
        crate::map_routes::maps,
        crate::tile_routes::tilejson,
        crate::tile_routes::tile,
        crate::track_routes::begin,
        crate::track_routes::list,
        crate::track_routes::track,
        crate::track_routes::end,
        crate::track_routes::frame,
        crate::track_events_route::events,
        crate::track_session_route::session,
        crate::health_routes::health,
        crate::health_routes::metrics,
    ),
    components(schemas(grimnet_answer::State, problem::Problem)),
    modifiers(&OfAllOperations)
)]
struct Document;

/// What all operations have in common: errors, the token, and answers whose fields are all there.
struct OfAllOperations;

impl Modify for OfAllOperations {
    fn modify(&self, document: &mut utoipa::openapi::OpenApi) {
        let content = Content::new(Some(Ref::from_schema_name("Problem")));
        let error = ResponseBuilder::new()
            .description("An error. Status 503 has a header `Retry-After`, seconds.")
            .content(problem::MEDIA_TYPE, content)
            .build();
        for path in document.paths.paths.values_mut() {
            let operations = [&mut path.get, &mut path.post, &mut path.delete];
            for operation in operations.into_iter().flatten() {
                let responses = &mut operation.responses.responses;
                responses.insert("default".to_owned(), error.clone().into());
            }
        }
        let scheme = HttpBuilder::new()
            .scheme(HttpAuthScheme::Bearer)
            .description(Some("Only if the service was started with a token."))
            .build();
        let components = document.components.get_or_insert_with(Components::new);
        components.add_security_scheme(TOKEN, SecurityScheme::Http(scheme));
        for name in SENT_WHOLE {
            if let Some(RefOr::T(Schema::Object(object))) = components.schemas.get_mut(name) {
                object.required = object.properties.keys().cloned().collect();
            }
        }
        let none: [&str; 0] = [];
        document.security = Some(vec![
            SecurityRequirement::default(),
            SecurityRequirement::new(TOKEN, none),
        ]);
    }
}

/// `GET /openapi.json`.
pub(crate) async fn document() -> impl IntoResponse {
    Json(Document::openapi())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reference_of_the_document_holds() {
        let document = serde_json::to_value(Document::openapi()).unwrap();
        let mut references = Vec::new();
        collect(&document, &mut references);
        assert!(references.len() > 5, "{references:?}");
        for reference in references {
            let pointer = reference.strip_prefix('#').unwrap();
            assert!(document.pointer(pointer).is_some(), "{reference}");
        }
        let locate = &document["paths"]["/v1/locate"]["post"]["requestBody"]["content"];
        assert!(locate["multipart/form-data"].is_object(), "{locate}");
        assert!(locate["image/jpeg"].is_object(), "{locate}");
        // A track may begin without a body.
        let begin = &document["paths"]["/v1/tracks"]["post"]["requestBody"];
        assert!(begin["content"]["application/json"].is_object(), "{begin}");
        assert_ne!(begin["required"], true, "{begin}");
    }

    #[test]
    fn bodies_of_json_are_no_strings() {
        let document = serde_json::to_value(Document::openapi()).unwrap();
        let geojson = &document["components"]["schemas"]["GeoJson"];
        assert_eq!(geojson["type"], "object", "{geojson}");
        let of = |path: &str, method: &str, media_type: &str| {
            let responses = &document["paths"][path][method]["responses"];
            responses["200"]["content"][media_type]["schema"].clone()
        };
        for (path, method, media_type) in [
            ("/v1/locate", "post", "application/geo+json"),
            ("/v1/answers", "post", "application/geo+json"),
            ("/v1/tracks/{id}", "get", "application/geo+json"),
            ("/v1/tracks/{id}", "get", "application/json"),
        ] {
            let schema = of(path, method, media_type);
            assert_eq!(schema["$ref"], "#/components/schemas/GeoJson", "{path}");
        }
    }

    #[test]
    fn every_operation_describes_its_errors() {
        let document = serde_json::to_value(Document::openapi()).unwrap();
        for (path, operations) in document["paths"].as_object().unwrap() {
            for (method, operation) in operations.as_object().unwrap() {
                let error = &operation["responses"]["default"]["content"];
                let schema = &error["application/problem+json"]["schema"];
                assert_eq!(
                    schema["$ref"], "#/components/schemas/Problem",
                    "{method} {path}"
                );
            }
        }
    }

    #[test]
    fn fields_that_are_always_sent_are_required() {
        let document = serde_json::to_value(Document::openapi()).unwrap();
        for name in SENT_WHOLE {
            let schema = &document["components"]["schemas"][name];
            let mut fields = schema["properties"].as_object().unwrap().keys();
            let required = schema["required"].as_array().unwrap();
            assert!(
                fields.all(|field| required.contains(&field.as_str().into())),
                "{name}: {required:?}"
            );
        }
    }

    fn collect(value: &serde_json::Value, found: &mut Vec<String>) {
        match value {
            serde_json::Value::Object(object) => {
                if let Some(reference) = object.get("$ref").and_then(|r| r.as_str()) {
                    found.push(reference.to_owned());
                }
                object.values().for_each(|value| collect(value, found));
            }
            serde_json::Value::Array(list) => list.iter().for_each(|value| collect(value, found)),
            _ => {}
        }
    }
}
