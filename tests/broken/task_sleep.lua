-- sleep in a namespace.
-- expect: check 3: task.sleep does not exist
task.sleep(1)
