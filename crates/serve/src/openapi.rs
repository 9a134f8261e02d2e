//! The OpenAPI document of the service.

use axum::Json;
use axum::response::IntoResponse;
use utoipa::OpenApi;

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
        crate::track_events::events,
        crate::track_session::session,
        crate::health::health,
        crate::health::metrics,
    ),
    components(schemas(grimnet_answer::State))
)]
struct Document;

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
