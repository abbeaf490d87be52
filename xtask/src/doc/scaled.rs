//! Tables of curves of the scaling suite: a row for each technique, a column for each value of the parameter.

use std::path::Path;

use anyhow::{bail, ensure};

use super::mark::Mark;
use crate::results::{Results, ScalingCurve, ScalingPoint};

/// Time as a multiple of the first value's, and root of the mean square error.
pub(super) fn table(mark: &Mark<'_>, docs: &Path) -> anyhow::Result<String> {
    mark.knows(&["file", "parameter", "scene", "light", "technique"])?;
    let (Some(file), Some(parameter)) = (mark.get("file"), mark.get("parameter")) else {
        bail!("names no file or no parameter")
    };
    let results = Results::read(&docs.join(file))?;
    let among = |key: &str, name: &str| mark.list(key).is_none_or(|list| list.contains(&name));
    let wanted = |curve: &&ScalingCurve| {
        curve.parameter == parameter
            && among("scene", &curve.scene)
            && among("light", curve.light.kind().name())
            && among("technique", &curve.technique)
    };
    let curves: Vec<&ScalingCurve> = results.scaling.iter().filter(wanted).collect();
    let Some(first) = curves.first() else { bail!("selects no curve of {file}") };
    let values = |curve: &ScalingCurve| curve.points.iter().map(|p| p.value).collect::<Vec<_>>();
    for curve in &curves {
        let same = curve.scene == first.scene && curve.light == first.light;
        ensure!(same && values(curve) == values(first), "selects curves over different values");
    }
    let titles: Vec<String> = first.points.iter().map(|point| point.value.to_string()).collect();
    let mut text = format!("\n| {} | {} |\n", parameter.replace('_', " "), titles.join(" | "));
    text += &format!("|---|{}\n", "--:|".repeat(titles.len()));
    for curve in &curves {
        let cells: Vec<String> = curve.points.iter().map(|p| cell(p, &curve.points[0])).collect();
        text += &format!("| `{}` | {} |\n", curve.technique, cells.join(" | "));
    }
    let [width, height] = results.settings.size;
    text += &format!(
        "\nGPU time as a multiple of the first column's, and RMSE. {}, {}, {} light; view {width} x {height}, map {}².\n\n",
        results.adapter.name,
        first.scene,
        first.light.kind().name(),
        results.settings.map_size
    );
    Ok(text)
}

fn cell(point: &ScalingPoint, first: &ScalingPoint) -> String {
    let time = point.gpu_ms.zip(first.gpu_ms).map(|(ms, first)| format!("{:.2}", ms / first));
    let error = point.rmse.map(|rmse| format!("{rmse:.4}"));
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
    format!("{}, {}", or_dash(time), or_dash(error))
}
