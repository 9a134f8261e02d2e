//! Hostile bodies: lengths, pictures, forms.

use crate::client::{FORM, form};
use crate::kind::Outcome::{Closed, Left, Status};
use crate::kind::{Act, BUSY, Kind, Outcome, ask, ask_each, kind, rare};
use crate::pictures;
use crate::request::Requests;

pub fn lengths(requests: &Requests) -> Vec<Kind> {
    let of = |headers: &[&str]| requests.head("POST /v1/locate", headers);
    let jpeg = "content-type: image/jpeg";
    let flood = Act::Flood {
        head: of(&[jpeg, "transfer-encoding: chunked"]),
        chunks: 1200,
    };
    vec![
        kind(
            "a body of a terabyte, declared",
            ask(of(&[jpeg, "content-length: 999999999999"])),
            &[Status(413), BUSY],
        ),
        kind(
            "a length that is no number of bytes",
            ask(of(&[jpeg, "content-length: 18446744073709551617"])),
            &[Status(400)],
        ),
        kind(
            "two lengths",
            ask(of(&[jpeg, "content-length: 5", "content-length: 6"])),
            &[Status(400)],
        ),
        kind(
            "a length and chunks",
            ask([
                of(&[jpeg, "content-length: 5", "transfer-encoding: chunked"]),
                b"zz\r\n".to_vec(),
            ]
            .concat()),
            &[Status(400), BUSY],
        ),
        kind(
            "a chunk of 16 exabytes",
            ask([
                of(&[jpeg, "transfer-encoding: chunked"]),
                b"ffffffffffffffff\r\n".to_vec(),
            ]
            .concat()),
            &[Status(400), Status(408), BUSY],
        ),
        // On a busy machine it does not arrive within the time; a reset may take the place of the answer.
        rare(kind(
            "a body of 75 MiB in chunks",
            flood,
            &[Status(413), Status(408), Closed, BUSY],
        )),
    ]
}

pub fn bombs(requests: &Requests, photo: &[u8]) -> Vec<Kind> {
    let of = |name: &'static str, file: &[u8], statuses: &[u16]| {
        let mut allowed: Vec<Outcome> = statuses.iter().copied().map(Status).collect();
        allowed.push(BUSY);
        kind(
            name,
            ask(requests.locate("application/octet-stream", file)),
            &allowed,
        )
    };
    vec![
        of(
            "a PNG of 900 megapixels",
            &pictures::png_of_many_pixels(),
            &[413],
        ),
        of(
            "a PNG of deep pixels",
            &pictures::png_of_deep_pixels(),
            &[413],
        ),
        of(
            "a JPEG of 4 gigapixels",
            &pictures::jpeg_of_many_pixels(photo),
            &[413],
        ),
        of(
            "a TIFF of 4 gigapixels",
            &pictures::tiff_of_many_pixels(),
            &[413],
        ),
        of(
            "a WebP of 268 megapixels",
            &pictures::webp_of_many_pixels(),
            &[413],
        ),
        of("a gzip stream", &pictures::gzip(), &[415]),
        rare(of(
            "a PNG with a profile of a gigabyte",
            &pictures::png_of_large_profile(),
            &[200, 413, 422],
        )),
        rare(of(
            "a PNG with texts of 6 gigabytes",
            &pictures::png_of_large_texts(),
            &[200, 413, 422],
        )),
        rare(of(
            "a JPEG of 20,000 scans",
            &pictures::jpeg_of_many_scans(),
            &[422],
        )),
    ]
}

pub fn bodies(requests: &Requests, photo: &[u8]) -> Vec<Kind> {
    let jpeg = |body: &[u8]| requests.locate("image/jpeg", body);
    let noise: Vec<u8> = (0..50_000_u32)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect();
    let encoded = [
        "content-type: image/jpeg",
        "content-encoding: gzip, deflate, br",
    ];
    vec![
        kind("noise for a photo", ask(jpeg(&noise)), &[Status(415), BUSY]),
        kind("no body", ask(jpeg(&[])), &[Status(400), BUSY]),
        kind(
            "half a photo",
            ask(jpeg(&photo[..photo.len() / 2])),
            &[Status(422), BUSY],
        ),
        kind(
            "the beginning of a PNG",
            ask(jpeg(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR")),
            &[Status(422), BUSY],
        ),
        kind(
            "other types of content",
            ask_each(
                [
                    "application/json",
                    "application/x-www-form-urlencoded",
                    "text/html",
                    "image/svg+xml",
                    "image/heic",
                    "multipart/mixed; boundary=XyZ",
                    "",
                    "; ; ;",
                ]
                .iter()
                .map(|kind| requests.locate(kind, b"{}"))
                .collect(),
            ),
            &[Status(415), BUSY],
        ),
        kind(
            "an encoding that is none",
            ask(requests.with_body("POST /v1/locate", &encoded, &noise)),
            &[Status(415), BUSY],
        ),
        kind(
            "a body that ends early",
            Act::Cut(
                [
                    requests.head(
                        "POST /v1/locate",
                        &["content-type: image/jpeg", "content-length: 90000"],
                    ),
                    noise.clone(),
                ]
                .concat(),
            ),
            &[Status(400), Closed, BUSY],
        ),
        kind(
            "a client that goes away amid its body",
            Act::Leave(
                [
                    requests.head(
                        "POST /v1/locate",
                        &["content-type: image/jpeg", "content-length: 90000"],
                    ),
                    noise,
                ]
                .concat(),
            ),
            &[Left],
        ),
        kind(
            "a client that goes away after its photo",
            Act::Leave(jpeg(&photo[..photo.len() / 2])),
            &[Left],
        ),
        kind(
            "answers that are none",
            ask_each(
                [
                    &b"{}"[..],
                    b"[[[[[[[[",
                    b"[{\"photo\": 7}]",
                    &b"[".repeat(200_000),
                    b"\xff\xfe",
                ]
                .iter()
                .map(|body| {
                    requests.with_body(
                        "POST /v1/answers",
                        &["content-type: application/json"],
                        body,
                    )
                })
                .collect(),
            ),
            &[Status(400), BUSY],
        ),
    ]
}

pub fn forms(requests: &Requests, photo: &[u8]) -> Vec<Kind> {
    let post = |content_type: &str, body: &[u8]| requests.locate(content_type, body);
    let type_of_form = FORM.trim_start_matches("content-type: ");
    let nested = [b"{\"near\": ".to_vec(), b"[".repeat(60_000)].concat();
    let name = "n".repeat(30_000);
    let bodies: Vec<Vec<u8>> = vec![
        post("multipart/form-data", b"x"),
        post("multipart/form-data; boundary=", b"--\r\n\r\n--"),
        post(
            &format!("multipart/form-data; boundary={}", "b".repeat(20_000)),
            b"--b",
        ),
        post(type_of_form, b"no form"),
        post(type_of_form, &b"--XyZ\r\n".repeat(20_000)),
        post(type_of_form, b"--XyZ\r\n\r\n"),
        post(
            type_of_form,
            &[b"--XyZ\r\n".to_vec(), b"a: b\r\n".repeat(50_000)].concat(),
        ),
        post(type_of_form, &form(&vec![("x", None, &b""[..]); 5_000])),
        post(
            type_of_form,
            &form(&[("photo", None, photo), ("photo", None, photo)]),
        ),
        post(
            type_of_form,
            &form(&[("prior", None, b"{}"), ("prior", None, b"{}")]),
        ),
        post(
            type_of_form,
            &form(&[("prior", None, &nested), ("photo", None, photo)]),
        ),
        post(type_of_form, &form(&[(&name, Some(&name), photo)])),
        post(
            type_of_form,
            &form(&[("photo\"; name=\"prior", Some("../../etc/passwd\0"), b"x")]),
        ),
    ];
    vec![
        kind(
            "forms that are none",
            ask_each(bodies),
            &[Status(400), Status(413), Status(415), BUSY],
        ),
        // On a busy machine it does not arrive within the time; a reset may take the place of the answer.
        kind(
            "a form without a boundary",
            ask(post(type_of_form, &vec![b' '; 8 << 20])),
            &[Status(400), Status(408), Closed, BUSY],
        ),
        kind(
            "a prior of a megabyte",
            ask(post(
                type_of_form,
                &form(&[("prior", None, &vec![b' '; 1 << 20])]),
            )),
            &[Status(413), BUSY],
        ),
    ]
}
