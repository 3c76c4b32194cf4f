import sys,collections,math
by=collections.OrderedDict()
for l in open(sys.argv[1]):
    w=l.split(None,4)
    if w and w[0] in 'EP' and len(w)>3: by.setdefault(w[1],[]).append(w if w[0]=='E' else l.split())
for k,ls in by.items():
    t0=None;P=[]
    for w in ls:
        if w[0]=='P':
            if t0 is not None: P.append(tuple(map(float,w[2:6])))
            continue
        s=' '.join(w[3:])
        if s.startswith('Heard Engine(Dock)'): t0=float(w[2]);P=[]
        elif 'Said Engine(' in s and t0 is not None:
            d=float(w[2])-t0
            if d>25 and 'BaseNotFound' in s:
                # longest and total stillness
                still=0;run=0;first=None;runs=[]
                for a,b in zip(P,P[1:]):
                    mv=math.hypot(b[1]-a[1],b[2]-a[2])+abs((b[3]-a[3]+math.pi)%(2*math.pi)-math.pi)*.1
                    if mv<.002*(b[0]-a[0])/.2+1e-4: 
                        if run==0: st=a[0]
                        run+=b[0]-a[0]
                    else:
                        if run>3: runs.append('%.0f@%.0f'%(run,st-t0))
                        run=0
                if run>3: runs.append('%.0f@%.0f'%(run,st-t0))
                print(k[-6:],'search %.0f s from %.0f: still'%(d,t0),runs)
            t0=None
