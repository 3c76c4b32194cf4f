-- Text that would control a terminal, or imitate a log record of the agent.
-- expect: error
local text = "\27[2J\27]0;owned\7\155\49m\r\n2026-01-01T00:00:00Z INFO docked safely\r\n\0\8\127\u{202e}"
print(text)
log.warn(text, { [text] = text })
pcall(robot.play, text)
error(text)
