//! Small configs of any plugin.

use contract::{complete_config::CompleteConfig, plugin::About};
use serde_json::Value;

/// The default config with those of the values that its plugin takes, one by one.
pub(crate) fn shrunk(about: &About, values: &Value) -> CompleteConfig {
    let mut config = about.defaults.clone();
    for (key, value) in values.as_object().into_iter().flatten() {
        let mut changed = config.clone();
        if changed.get(key).is_some() {
            changed[key] = value.clone();
            // A value that another plugin means by this key is left out.
            config = (about.resolve)(&changed).unwrap_or(config);
        }
    }
    config
}

#[test]
fn a_config_takes_the_values_that_fit_it_and_no_others() {
    let registry = plugins::registry();
    let about = &registry.agents["ddpg"].about;
    let values = serde_json::json!({ "width": 6, "batch_size": "many", "no_such_key": 1 });
    let config = shrunk(about, &values);
    assert_eq!(
        (&config["width"], &config["batch_size"]),
        (&6.into(), &about.defaults["batch_size"])
    );
    assert!(config.get("no_such_key").is_none());
}
