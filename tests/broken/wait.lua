-- wait of other runtimes.
-- expect: check 3: unknown name 'wait'
wait(1)
