import sys,math,collections
# time use per phase: search (after Engine(Dock) until grant) and grant
tot=collections.Counter(); 
for fn in sys.argv[1:]:
    ev=collections.defaultdict(list);P=collections.defaultdict(list)
    for l in open(fn):
        w=l.split(None,4)
        if not w: continue
        if w[0]=='E': ev[w[1]].append((float(w[2]),w[3]+' '+(w[4] if len(w)>4 else '')))
        elif w[0]=='P':
            v=l.split(); P[v[1]].append(tuple(map(float,v[2:7])))
    for k,p in P.items():
        e=sorted(ev[k]);i=0;phase='search'
        for a,b in zip(p,p[1:]):
            while i<len(e) and e[i][0]<=a[0]:
                t=e[i][1]
                if 'Engine(Dock)' in t: phase='search'
                elif 'a rescue behaviour may drive' in t: phase='grant'
                i+=1
            dt=b[0]-a[0]
            if dt>1: continue
            v=math.hypot(b[1]-a[1],b[2]-a[2])/dt; w=abs((b[3]-a[3]+math.pi)%(2*math.pi)-math.pi)/dt
            kind='drive' if v>0.05 else 'turn' if w>0.2 else 'stand'
            tot[phase,kind]+=dt; tot[phase,'all']+=dt
            if phase=='grant' and kind=='drive': tot['m','']+=v*dt
        tot['n','']+=1; tot['grants','']+=sum('a rescue behaviour may drive' in x[1] for x in e)
n=tot['n','']
for q,v in sorted(tot.items()): print(q,round(v/n,1))
