//! The frame of every HTML page: document, style, title.

use maud::{DOCTYPE, Markup, PreEscaped, html};

/// On a phone, wide tables and curves scroll sideways: a curve that shrinks with the page loses its labels.
const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem;color:#222}\
table{display:block;overflow-x:auto;border-collapse:collapse;margin:1rem 0}td,th{padding:.25rem .8rem;text-align:right;border-bottom:1px solid #ddd}\
td:first-child,th:first-child{text-align:left}img,svg{max-width:100%;height:auto}figure{margin:1.5rem 0;overflow-x:auto}\
figure svg{min-width:40rem}figcaption{color:#555}.miss{color:#b00}";

/// A page with this title and content; it refers to nothing outside itself.
#[must_use]
pub fn page(title: &str, content: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (title) }
                (content)
            }
        }
    };
    page.into_string()
}

/// A picture in SVG, which the plotting library has escaped.
#[must_use]
pub fn svg(svg: String) -> Markup {
    PreEscaped(svg)
}
