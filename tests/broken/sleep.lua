-- sleep of other languages.
-- expect: check 3: unknown name 'sleep'
sleep(1)
