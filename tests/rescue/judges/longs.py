import sys,collections
# searches longer than 25 s that did not dock; and what became of the run
by=collections.OrderedDict()
for l in open(sys.argv[1]):
    w=l.split(None,4)
    if w and w[0] in 'EP' and len(w)>3: by.setdefault(w[1],[]).append(w if w[0]=='E' else l.split())
tot=0
for k,ls in by.items():
    t0=None;bat=9;o=[];end=None
    for w in ls:
        if w[0]=='P': bat=float(w[6]);continue
        s=' '.join(w[3:])
        if s.startswith('Heard Engine(Dock)'): t0=float(w[2])
        elif 'Said Engine(' in s and t0 is not None:
            d=float(w[2])-t0
            if d>25: o.append('%s %.0f->%s'%(s.split('Engine(')[1].split(')')[0],t0,w[2]))
            t0=None
    lost=bat<.5
    if o: print(k[-6:],'LOST' if lost else 'home',o)
