import sys,collections,math
order=[];by=collections.defaultdict(list)
for l in open(sys.argv[1]):
    w=l.split(None,3)
    if w and w[0] in 'EP':
        if w[1] not in by: order.append(w[1])
        by[w[1]].append(l)
H=collections.defaultdict(list)
for k in order:
    ls=by[k];lastt=None;bat=9;t0=0;dur=0;al=0;n=0
    for l in ls:
        w=l.split()
        if w[0]=='P': true=tuple(map(float,w[3:6]));bat=float(w[6])
        elif 'Engine(Dock)' in l and w[3]=='Heard': t0=float(w[2])
        elif 'may drive for' in l: dur=float(w[2])-t0
        elif w[3]=='Log' and ' A ' in l: al=math.degrees(float(w[w.index('A')+1]))
        elif w[3]=='Log' and ' B ' in l:
            i=w.index('B');b=tuple(map(float,w[i+1:i+4]))
            if lastt:
                dh=(b[2]-lastb[2])-(true[2]-lastt[2]);dh=math.degrees((dh+math.pi)%(2*math.pi)-math.pi)
                H['cut' if dur<19 else 'full'].append((abs(dh),dh,al,k[-6:],n))
            n+=1;al=0
            lastt,lastb=true,b
for k,v in H.items():
    s=sorted(x[0] for x in v)
    print(k,len(s),'med %.1f p80 %.1f p90 %.1f >30 %d'%(s[len(s)//2],s[int(len(s)*.8)],s[int(len(s)*.9)],sum(x>30 for x in s)))
    print([('%+.0f'%x[1],'al %+.0f'%x[2],x[3],x[4]) for x in v if x[0]>25])
