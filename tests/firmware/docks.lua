-- Docks, says how that went, and waits.
local home, code = robot.dock({ retries = 0 })
log.info(`docked: {home}, {code}`)
robot.wait_for("battery_ok")
