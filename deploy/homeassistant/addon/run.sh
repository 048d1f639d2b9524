#!/usr/bin/with-contenv bashio
# The add-on's options become radard's; without a device, a radar is simulated.
set -eu
data=${DATA:-/data}
export STATE_DIRECTORY="$data/state" RUNTIME_DIRECTORY="${RUNTIME:-/run/radard}"
port=sim:demo
if bashio::config.has_value device; then
    port=$(bashio::config device)
fi
RADARD_SENSOR__NAME=$(bashio::config name)
RADARD_ALARM__SENSITIVITY=$(bashio::config sensitivity)
RADARD_ALARM__ENTRY_DELAY_S=$(bashio::config entry_delay_s)
export RADARD_SENSOR__NAME RADARD_ALARM__SENSITIVITY RADARD_ALARM__ENTRY_DELAY_S

# The dashboard is reached from other machines, so it has a token: given, or made once.
if bashio::config.has_value token; then
    DASHBOARD_TOKEN=$(bashio::config token)
else
    [ -s "$data/token" ] || (umask 077 && od -An -N16 -tx1 /dev/urandom | tr -d ' \n' >"$data/token")
    DASHBOARD_TOKEN=$(cat "$data/token")
    bashio::log.info "token of the dashboard: $DASHBOARD_TOKEN"
fi
export DASHBOARD_TOKEN RADARD_WEB__TOKEN_ENV=DASHBOARD_TOKEN
set -- --port "$port" --wait -o http://0.0.0.0:8434

if bashio::services.available mqtt; then
    scheme=mqtt
    if [ "$(bashio::services mqtt ssl)" = true ]; then
        scheme=mqtts
    fi
    MQTT_PASSWORD=$(bashio::services mqtt password)
    RADARD_MQTT__USERNAME=$(bashio::services mqtt username)
    export MQTT_PASSWORD RADARD_MQTT__USERNAME RADARD_MQTT__PASSWORD_ENV=MQTT_PASSWORD
    set -- "$@" -o "$scheme://$(bashio::services mqtt host):$(bashio::services mqtt port)"
else
    bashio::log.warning "no MQTT broker: Home Assistant will have no entities of the radar"
fi
mkdir -p "$STATE_DIRECTORY" "$RUNTIME_DIRECTORY"
exec ${RADARD:-/opt/radard/bin/radard} "$@"
