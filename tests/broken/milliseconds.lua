-- Milliseconds where seconds are wanted.
-- expect: check 3: task.wait takes seconds: 1000 are 17 minutes
task.wait(1000)
