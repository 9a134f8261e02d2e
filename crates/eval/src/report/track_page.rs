//! One self-contained HTML page of a track: its plan with error ellipses, beside the truth where it is known.

use std::fmt::Write as _;

use grimnet_geo::{GeoError, LonLat, Raster};
use maud::{Markup, html};
use nalgebra::{Matrix2, SymmetricEigen};

use super::html;
use super::track_plan::Plan;
use crate::metrics::statistics::percentile;

/// Ellipses that are drawn at most: those in between are left out.
const MOST_ELLIPSES: usize = 80;
/// Standard deviations of the 95 % ellipse of two normal variables, the root of chi-square's quantile 5.991.
const SIGMAS_95: f64 = 2.447_746_8;
/// Width and height of the curve of errors, pixels.
const CURVE_PX: [f64; 2] = [1000.0, 260.0];

/// A point of the track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackMark {
    /// Seconds.
    pub time_s: f64,
    /// Where the track is; `None` where it may not be used.
    pub place: Option<LonLat>,
    /// Covariance, square metres: east-east, east-north, north-north.
    pub covariance_en_m2: [f64; 3],
    /// Stated 95 % radius, metres.
    pub radius95_m: f64,
    /// Whether it rests on a fix at this time.
    pub is_fix: bool,
    /// Where it truly was, if that is known.
    pub truth: Option<LonLat>,
}

/// The content of the page.
#[derive(Debug, Clone)]
pub struct TrackPage {
    /// Its title.
    pub title: String,
    /// A line or two on the flight.
    pub description: Vec<String>,
    /// Name and value of each figure.
    pub figures: Vec<(String, String)>,
    /// In order of time.
    pub marks: Vec<TrackMark>,
}

/// Why a page cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrackPageError {
    /// The map cannot be read.
    #[error(transparent)]
    Map(#[from] GeoError),
    /// The map's picture cannot be encoded.
    #[error("cannot encode the map's picture: {0}")]
    Picture(#[from] image::ImageError),
}

impl TrackPage {
    /// The page as HTML; it refers to nothing outside itself. With a map, the plan is drawn on it.
    ///
    /// # Errors
    /// The map cannot be read.
    pub fn to_html(&self, map: Option<&dyn Raster>) -> Result<String, TrackPageError> {
        let plan = self.plan_svg(map)?;
        let errors = self.errors_svg();
        let content = html! {
            @for line in &self.description { p { (line) } }
            table {
                @for (name, value) in &self.figures { tr { td { (name) } td { (value) } } }
            }
            @match plan {
                Some(plan) => (figure(plan, "The track (blue) with 95 % ellipses, fixes (dots) and the truth (green), north up")),
                None => p { "No position was found." },
            }
            @if let Some(errors) = errors {
                (figure(errors, "Distance from the truth (blue) and stated 95 % radius (grey, cut off at the top) over time"))
            }
        };
        Ok(html::page(&self.title, &content))
    }

    fn plan_svg(&self, map: Option<&dyn Raster>) -> Result<Option<String>, TrackPageError> {
        let places: Vec<LonLat> = self
            .marks
            .iter()
            .flat_map(|mark| [mark.place, mark.truth])
            .flatten()
            .collect();
        let Some(plan) = Plan::around(&places) else {
            return Ok(None);
        };
        let [width, height] = plan.size_px();
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" \
             height=\"{height:.0}\"><rect width=\"100%\" height=\"100%\" fill=\"#f4f4f0\"/>"
        );
        if let Some(map) = map
            && let Some(background) = plan.background(map)?
        {
            svg += &background.svg()?;
        }
        let truth = self.marks.iter().map(|mark| mark.truth);
        lines(&mut svg, &plan, truth, "#12a02a", 4.0);
        let step = self.marks.len().div_ceil(MOST_ELLIPSES).max(1);
        for mark in self.marks.iter().step_by(step) {
            if let Some(place) = mark.place {
                ellipse(&mut svg, &plan, place, mark.covariance_en_m2);
            }
        }
        lines(
            &mut svg,
            &plan,
            self.marks.iter().map(|mark| mark.place),
            "#1450d2",
            2.0,
        );
        for mark in self.marks.iter().filter(|mark| mark.is_fix) {
            if let Some([x, y]) = mark.place.map(|place| plan.px(place)) {
                // Writing to a string does not fail.
                let _ = write!(
                    svg,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.5\" fill=\"#1450d2\"/>"
                );
            }
        }
        scale_bar(&mut svg, &plan);
        svg += "</svg>";
        Ok(Some(svg))
    }

    fn errors_svg(&self) -> Option<String> {
        let at: Vec<(f64, Option<f64>, f64)> = self
            .marks
            .iter()
            .filter_map(|mark| {
                let truth = mark.truth?;
                let error_m = mark
                    .place
                    .map(|place| grimnet_geo::distance_m(place, truth));
                Some((mark.time_s, error_m, mark.radius95_m))
            })
            .collect();
        let (first_s, last_s) = (at.first()?.0, at.last()?.0);
        let mut sorted: Vec<f64> = at.iter().flat_map(|(_, e, _)| *e).collect();
        sorted.sort_by(f64::total_cmp);
        let radii: Vec<f64> = at.iter().filter_map(|(_, e, r)| e.map(|_| *r)).collect();
        // The usual radius is shown; those of a coasting track would leave no room for the errors.
        let usual_radius_m = percentile(&radii, 0.5)?;
        let top_m = (1.5 * sorted.last()?).max(1.2 * usual_radius_m).max(5.0);
        let [width, height] = CURVE_PX;
        let x =
            |time_s: f64| 60.0 + (width - 70.0) * (time_s - first_s) / (last_s - first_s).max(1e-9);
        let y = |metres: f64| (height - 30.0) * (1.0 - metres.min(top_m) / top_m) + 5.0;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
             font-family=\"sans-serif\" font-size=\"13\">"
        );
        for part in 0..=4 {
            let metres = top_m * f64::from(part) / 4.0;
            let _ = write!(
                svg,
                "<path d=\"M60 {0:.1}H{width}\" stroke=\"#ddd\"/><text x=\"54\" y=\"{1:.1}\" text-anchor=\"end\">{metres:.1} m</text>",
                y(metres),
                y(metres) + 4.0
            );
        }
        let _ = write!(
            svg,
            "<text x=\"{width}\" y=\"{}\" text-anchor=\"end\">{:.0} s</text>",
            height - 6.0,
            last_s - first_s
        );
        let stated = at.iter().map(|(t, e, r)| e.map(|_| [x(*t), y(*r)]));
        polyline(&mut svg, stated, "#999", 1.5);
        let errors = at.iter().map(|(t, e, _)| e.map(|e| [x(*t), y(e)]));
        polyline(&mut svg, errors, "#1450d2", 2.0);
        svg += "</svg>";
        Some(svg)
    }
}

fn figure(svg: String, caption: &str) -> Markup {
    html! { figure { (html::svg(svg)) figcaption { (caption) } } }
}

fn lines(
    svg: &mut String,
    plan: &Plan,
    places: impl Iterator<Item = Option<LonLat>>,
    colour: &str,
    width_px: f64,
) {
    let points = places.map(|place| place.map(|place| plan.px(place)));
    polyline(svg, points, colour, width_px);
}

/// A line that is interrupted where there is no point.
fn polyline(
    svg: &mut String,
    points: impl Iterator<Item = Option<[f64; 2]>>,
    colour: &str,
    width_px: f64,
) {
    let mut path = String::new();
    let mut command = 'M';
    for point in points {
        let Some([x, y]) = point else {
            command = 'M';
            continue;
        };
        let _ = write!(path, "{command}{x:.1} {y:.1}");
        command = 'L';
    }
    let _ = write!(
        svg,
        "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width_px}\" stroke-linejoin=\"round\" \
         stroke-linecap=\"round\"/>"
    );
}

/// The 95 % ellipse of a covariance.
fn ellipse(svg: &mut String, plan: &Plan, place: LonLat, [ee, en, nn]: [f64; 3]) {
    let eigen = SymmetricEigen::new(Matrix2::new(ee, en, en, nn));
    let radius_px = |i: usize| SIGMAS_95 * eigen.eigenvalues[i].max(0.0).sqrt() * plan.px_per_m;
    let axis = eigen.eigenvectors.column(0);
    // The picture's y axis points down.
    let turn_deg = -axis[1].atan2(axis[0]).to_degrees();
    let [x, y] = plan.px(place);
    let _ = write!(
        svg,
        "<ellipse rx=\"{:.1}\" ry=\"{:.1}\" transform=\"translate({x:.1} {y:.1}) rotate({turn_deg:.1})\" fill=\"#1450d2\" \
         fill-opacity=\"0.12\" stroke=\"#1450d2\" stroke-opacity=\"0.5\"/>",
        radius_px(0),
        radius_px(1)
    );
}

/// A bar of a round length, about a fifth of the plan.
fn scale_bar(svg: &mut String, plan: &Plan) {
    let wanted_m = plan.size_m[0] / 5.0;
    let power = 10f64.powf(wanted_m.log10().floor());
    let length_m = [5.0, 2.0, 1.0]
        .map(|factor| factor * power)
        .into_iter()
        .find(|length_m| *length_m <= wanted_m)
        .unwrap_or(power);
    let [_, height] = plan.size_px();
    let end = 20.0 + length_m * plan.px_per_m;
    let _ = write!(
        svg,
        "<path d=\"M20 {0:.1}H{end:.1}\" stroke=\"#000\" stroke-width=\"3\"/><text x=\"20\" y=\"{1:.1}\" \
         font-family=\"sans-serif\" font-size=\"16\">{length_m} m</text>",
        height - 15.0,
        height - 22.0
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_geo::destination_en_m;

    fn page(count: usize) -> TrackPage {
        let origin = LonLat::new(120.7, 24.2);
        let marks = (0..count)
            .map(|i| TrackMark {
                time_s: i as f64,
                place: (i != 3).then(|| destination_en_m(origin, 10.0 * i as f64, 2.0)),
                covariance_en_m2: [4.0, 0.0, 1.0],
                radius95_m: 4.0,
                is_fix: i % 2 == 0,
                truth: Some(destination_en_m(origin, 10.0 * i as f64, 0.0)),
            })
            .collect();
        TrackPage {
            title: "A flight".into(),
            description: vec!["a < b".into()],
            figures: vec![("median".into(), "2.0 m".into())],
            marks,
        }
    }

    #[test]
    fn the_plan_has_north_up_and_one_scale() {
        let origin = LonLat::new(10.0, 50.0);
        let north = destination_en_m(origin, 0.0, 100.0);
        let plan = Plan::around(&[origin, north]).unwrap();
        let (at, above) = (plan.px(origin), plan.px(north));
        assert!((at[0] - above[0]).abs() < 1e-6);
        assert!((at[1] - above[1] - 100.0 * plan.px_per_m).abs() < 1e-6);
        assert!(Plan::around(&[]).is_none());
    }

    #[test]
    fn the_axis_of_errors_reaches_to_the_usual_radius() {
        let mut page = page(8);
        for mark in &mut page.marks {
            mark.radius95_m = 30.0;
        }
        // The longest one is cut off.
        page.marks[7].radius95_m = 300.0;
        let html = page.to_html(None).unwrap();
        let radii = html
            .split("\" fill=\"none\" stroke=\"#999\"")
            .next()
            .unwrap();
        let path = radii.rsplit("<path d=\"").next().unwrap();
        assert!(path.starts_with("M60.0 43.3L"), "{path}");
        assert!(path.ends_with(" 5.0"), "{path}");
    }

    #[test]
    fn the_page_is_interrupted_where_the_track_is() {
        let html = page(8).to_html(None).unwrap();
        assert!(html.contains("a &lt; b"));
        assert_eq!(html.matches("<ellipse").count(), 7);
        assert_eq!(html.matches("<svg").count(), 2);
        let track = html
            .split("stroke=\"#1450d2\" stroke-width=\"2\"")
            .next()
            .unwrap();
        let path = track.rsplit("<path d=\"").next().unwrap();
        assert_eq!(path.matches('M').count(), 2, "{path}");
        assert!(!html.contains("NaN"));
        let empty = TrackPage {
            marks: Vec::new(),
            ..page(0)
        };
        assert!(empty.to_html(None).unwrap().contains("No position"));
    }
}
